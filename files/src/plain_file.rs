//! Opening files that somebody else may have put there: regular files only, and, inside an archive, no links.
//!
//! A link in a served folder may lead to any file that the server can read, and opening a pipe with no writer blocks for ever.
//! So a file is opened without blocking, and checked again once it is open.
//! Failures: an [`io::Error`] that says what was found instead; [`is_other`] recognises it.

use std::fmt;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

/// What was found instead of a regular file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Other {
    Folder,
    Special,
    Link,
    BehindLink,
    LinkInstead,
}

impl fmt::Display for Other {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Folder => "it is a folder, not a file",
            Self::Special => "it is a pipe, a socket or a device, not a regular file; nothing was read from it",
            Self::Link => "it is a link; links are not followed inside an archive; put the file itself there",
            Self::LinkInstead => "it is a link, and links are not followed here; nothing was read or written",
            Self::BehindLink => {
                "a folder above it is a link; links are not followed inside an archive; put the folder itself there"
            }
        })
    }
}

impl std::error::Error for Other {}

impl Other {
    fn error(self) -> io::Error {
        let kind = if self == Self::Folder { io::ErrorKind::IsADirectory } else { io::ErrorKind::InvalidInput };
        io::Error::new(kind, self)
    }
}

/// Whether an error says that something is a link, a folder or a special file.
pub fn is_other(e: &io::Error) -> bool {
    e.get_ref().is_some_and(<dyn std::error::Error + Send + Sync>::is::<Other>)
}

/// Open a regular file that a user named; links are followed.
///
/// # Errors
/// The system's error, or one that says that it is not a regular file.
pub fn open(path: &Path) -> io::Result<File> {
    // Checked before it is opened, because merely opening some devices has an effect: a tape rewinds.
    kind_of(&fs::metadata(path)?)?;
    let file = options().open(path)?;
    kind_of(&file.metadata()?)?;
    Ok(file)
}

/// Open a regular file inside the archive folder `root`. `root` itself may be a link; no link below it is followed.
///
/// # Errors
/// The system's error, or one that says that it is a link, is below one, is not a regular file, or was replaced meanwhile.
pub fn open_inside(root: &Path, path: &Path) -> io::Result<File> {
    metadata_inside(root, path)?;
    open_between(path, &options(), || metadata_inside(root, path))
}

/// Open a file of our own for reading and writing, in a place where somebody else may have put something else. It must be a regular
/// file and not a link; folders above it may be links.
///
/// # Errors
/// The system's error, or one that says that it is a link, is not a regular file, or was replaced meanwhile.
pub fn open_own(path: &Path) -> io::Result<File> {
    metadata_own(path)?;
    open_between(path, options().write(true), || metadata_own(path))
}

/// The metadata of the file that [`open_own`] would open.
fn metadata_own(path: &Path) -> io::Result<Metadata> {
    let metadata = fs::symlink_metadata(path)?;
    if metadata.is_symlink() {
        return Err(Other::LinkInstead.error());
    }
    kind_of(&metadata).map(|()| metadata)
}

/// Open `path`. The open file must be the one that `look` finds there afterwards: without this comparison, a link that is in its place
/// only at the moment of opening would be followed.
fn open_between(path: &Path, options: &OpenOptions, look: impl FnOnce() -> io::Result<Metadata>) -> io::Result<File> {
    let file = options.open(path)?;
    let opened = file.metadata()?;
    kind_of(&opened)?;
    if is_same_file(&opened, &look()?) { Ok(file) } else { Err(replaced()) }
}

/// The error for a file that was replaced while it was being opened.
pub fn replaced() -> io::Error {
    io::Error::new(io::ErrorKind::PermissionDenied, "the file was replaced while it was being opened")
}

/// Whether two sets of metadata belong to the same file.
#[cfg(unix)]
pub fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// Whether two sets of metadata belong to the same file, as far as this can be known without inode numbers.
#[cfg(not(unix))]
pub fn is_same_file(a: &Metadata, b: &Metadata) -> bool {
    (a.created().ok(), a.modified().ok(), a.len()) == (b.created().ok(), b.modified().ok(), b.len())
}

/// A text that changes whenever a file is changed or replaced: its length, its `mtime` and `ctime` to the nanosecond, and its inode. If the
/// text is the same, so are the file and its content, except on systems with coarse times.
#[cfg(unix)]
pub fn stamp(metadata: &Metadata) -> String {
    use std::os::unix::fs::MetadataExt;
    format!(
        "{} {}.{:09} {}.{:09} {}",
        metadata.len(),
        metadata.mtime(),
        metadata.mtime_nsec(),
        metadata.ctime(),
        metadata.ctime_nsec(),
        metadata.ino()
    )
}

/// A text that changes whenever a file is changed or replaced, as far as the system shows: its length, and when it was written and created.
#[cfg(not(unix))]
pub fn stamp(metadata: &Metadata) -> String {
    let nanoseconds = |time: io::Result<std::time::SystemTime>| {
        time.ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok()).map_or(0, |t| t.as_nanos())
    };
    format!("{} {} {}", metadata.len(), nanoseconds(metadata.modified()), nanoseconds(metadata.created()))
}

/// Open a regular file whose path contains no link at all, as a path below a canonical one should.
///
/// # Errors
/// As for [`open_inside`].
pub fn open_direct(path: &Path) -> io::Result<File> {
    open_inside(Path::new(""), path)
}

/// The metadata of the file that [`open_direct`] would open.
///
/// # Errors
/// As for [`open_inside`].
pub fn metadata_direct(path: &Path) -> io::Result<Metadata> {
    metadata_inside(Path::new(""), path)
}

/// The metadata of the file that [`open_inside`] would open.
///
/// # Errors
/// As for [`open_inside`].
pub fn metadata_inside(root: &Path, path: &Path) -> io::Result<Metadata> {
    let metadata = fs::symlink_metadata(path)?;
    if metadata.is_symlink() {
        return Err(Other::Link.error());
    }
    kind_of(&metadata)?;
    if is_behind_link(root, path)? { Err(Other::BehindLink.error()) } else { Ok(metadata) }
}

/// Whether `path` is a folder inside the archive folder `root` and no part below `root` is a link.
pub fn is_folder_inside(root: &Path, path: &Path) -> bool {
    if path == root {
        return path.is_dir();
    }
    fs::symlink_metadata(path).is_ok_and(|m| m.is_dir()) && is_behind_link(root, path).is_ok_and(|behind| !behind)
}

fn is_behind_link(root: &Path, path: &Path) -> io::Result<bool> {
    for folder in path.ancestors().skip(1).take_while(|folder| *folder != root && !folder.as_os_str().is_empty()) {
        if fs::symlink_metadata(folder)?.is_symlink() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// All of an open file of at most `max` bytes.
///
/// # Errors
/// The system's error, or [`io::ErrorKind::FileTooLarge`] if it is longer.
pub fn read(file: File, max: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(max.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > max {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it is longer than {max} bytes")));
    }
    Ok(bytes)
}

/// All of a regular file of at most `max` bytes; links are followed.
///
/// # Errors
/// As for [`open`] and [`read`].
pub fn read_at(path: &Path, max: u64) -> io::Result<Vec<u8>> {
    read(open(path)?, max)
}

fn kind_of(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    Err(if metadata.is_dir() { Other::Folder } else { Other::Special }.error())
}

fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        // Opening a pipe does not wait for a writer, and a terminal does not become our controlling terminal. Regular files are not affected.
        options.custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY);
    }
    options
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::process::Command;

    #[test]
    fn only_regular_files_are_opened_and_nothing_blocks() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "x").unwrap();
        symlink(at("file"), at("link")).unwrap();
        symlink("/dev/zero", at("device")).unwrap();
        assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        assert_eq!(read(open(&at("file")).unwrap(), 1).unwrap(), b"x");
        assert_eq!(read(open(&at("link")).unwrap(), 1).unwrap(), b"x");
        assert!(read(open(&at("file")).unwrap(), 0).is_err());
        for name in ["pipe", "device", "."] {
            assert!(is_other(&open(&at(name)).unwrap_err()), "{name}");
        }
        assert_eq!(open(&at("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_stamp_differs_after_any_change_even_with_the_old_time_and_length() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("file"), folder.path().join("other"));
        let now = || stamp(&fs::metadata(&path).unwrap());
        fs::write(&path, "one").unwrap();
        let (before, time) = (now(), fs::metadata(&path).unwrap().modified().unwrap());
        assert_eq!(now(), before);
        let put_back = || File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        // File times may advance in steps of a few milliseconds: wait for the next one.
        let began = std::time::Instant::now();
        while now() == before {
            assert!(began.elapsed().as_secs() < 60, "written in place");
            fs::write(&path, "two").unwrap();
            put_back();
        }
        fs::write(&other, "one").unwrap();
        fs::rename(&other, &path).unwrap();
        put_back();
        assert_ne!(now(), before, "replaced");
    }

    #[test]
    fn an_owned_file_is_neither_a_link_nor_a_pipe() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "x").unwrap();
        symlink(at("file"), at("link")).unwrap();
        assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        io::Write::write_all(&mut open_own(&at("file")).unwrap(), b"y").unwrap();
        assert_eq!(fs::read(at("file")).unwrap(), b"y");
        for name in ["link", "pipe", "."] {
            assert!(is_other(&open_own(&at(name)).unwrap_err()), "{name}");
        }
    }

    #[test]
    fn a_link_that_replaces_the_file_during_opening_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, secret) = (folder.path().join("file"), folder.path().join("secret"));
        fs::write(&secret, "secret").unwrap();
        symlink(&secret, &file).unwrap();
        let looked = open_between(&file, &options(), || {
            fs::remove_file(&file)?;
            fs::write(&file, "x")?;
            metadata_direct(&file)
        });
        assert_eq!(looked.unwrap_err().to_string(), replaced().to_string());
        assert_eq!(read(open_direct(&file).unwrap(), 1).unwrap(), b"x");
    }

    #[test]
    fn no_link_inside_an_archive_is_followed_at_any_depth() {
        let folder = tempfile::tempdir().unwrap();
        let (real, root) = (folder.path().join("real"), folder.path().join("root"));
        fs::create_dir_all(real.join("v1/deep")).unwrap();
        fs::write(real.join("v1/deep/file"), "x").unwrap();
        symlink(&real, &root).unwrap();
        let inside = |path: &str| open_inside(&root, &root.join(path));
        assert!(inside("v1/deep/file").is_ok(), "the archive's own folder may be a link");
        symlink("v1", real.join("v2")).unwrap();
        symlink("v1/deep/file", real.join("file")).unwrap();
        for path in ["file", "v2/deep/file"] {
            assert!(is_other(&inside(path).unwrap_err()), "{path}");
        }
    }
}
