//! Bytes of buffers and of buffer views, wherever they lie: in the GLB, in files beside it, in data URIs, compressed.
//!
//! Nothing is opened before it is used, so that what no surface needs may be missing. Plain views are read in pieces;
//! compressed ones are decoded whole and the last few are kept, because exporters put many meshes into one view.

use super::super::companions::{Found, Opened, Reference};
use super::super::{Bytes, ReadError};
use super::Context;
use super::schema::{Meshopt, Root};
use base64::Engine;
use base64::alphabet;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use kilwa_pack::plural::counted;
use kilwa_pack::visible::visible;
use meshoptimizer_rs::codec;
use percent_encoding::percent_decode_str;
use std::io::{Read, SeekFrom};
use std::path::PathBuf;
use std::rc::Rc;

/// What URIs begin with that hold the bytes themselves.
const DATA: &str = "data:";
/// Decoded views that are kept.
const KEPT: usize = 8;

/// Padding may be there or not, and so may bits behind the last byte.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// The bytes of one buffer.
enum Store {
    /// In the GLB: offset and length.
    Inside(u64, u64),
    /// A file of so many bytes.
    Beside(Opened, u64),
    Memory(Rc<Vec<u8>>),
}

/// Where the bytes of a view are.
#[derive(Clone)]
pub(super) enum ViewBytes {
    /// In a buffer: number, offset and length.
    Stored(usize, u64, u64),
    Decoded(Rc<Vec<u8>>),
}

impl ViewBytes {
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::Stored(_, _, length) => *length,
            Self::Decoded(bytes) => bytes.len() as u64,
        }
    }
}

/// All bytes that the JSON names.
pub(super) struct Buffers<'a> {
    source: &'a mut dyn Bytes,
    binary: Option<(u64, u64)>,
    stores: Vec<Option<Store>>,
    decoded: Vec<(usize, Rc<Vec<u8>>)>,
    /// The most bytes that decoded views may take together.
    max: u64,
    /// Called with the bytes done and the total.
    progress: &'a mut super::super::OnProgress<'a>,
    done: u64,
    total: u64,
    reported: u64,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(
        source: &'a mut dyn Bytes,
        total: u64,
        binary: Option<(u64, u64)>,
        root: &Root,
        max: u64,
        progress: &'a mut super::super::OnProgress<'a>,
    ) -> Self {
        let stores = root.buffers.iter().map(|_| None).collect();
        Self { source, binary, stores, decoded: Vec::new(), max, progress, done: 0, total, reported: 0 }
    }

    /// Bytes of the file and of those beside it that were opened.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// The most bytes that what is decoded may take.
    pub(super) fn max(&self) -> u64 {
        self.max
    }

    /// Tell the progress that all is read.
    pub(super) fn finish(&mut self) {
        (self.progress)(self.total, self.total);
    }

    /// The bytes of view `index`: plain, or decoded.
    pub(super) fn view(&mut self, root: &Root, index: usize, context: &Context<'_>) -> Result<ViewBytes, ReadError> {
        let part = || format!("bufferViews[{index}]");
        let Some(view) = root.views.get(index) else {
            let found = format!("no such buffer view (there are {})", root.views.len());
            return Err(context.part(part(), found, "a buffer view of this file"));
        };
        let extensions = &view.extensions;
        if let Some(packed) = extensions.ext_meshopt.as_ref().or(extensions.khr_meshopt.as_ref()) {
            if let Some((_, bytes)) = self.decoded.iter().find(|(i, _)| *i == index) {
                return Ok(ViewBytes::Decoded(Rc::clone(bytes)));
            }
            let size = packed.count.saturating_mul(packed.byte_stride);
            if size > self.max {
                let found = format!("a compressed view of {size} bytes; at most {} fit in memory", self.max);
                let expected = "a smaller one; give a larger --memory, or export the file without compression";
                return Err(context.part(part(), found, expected));
            }
            let kept = |all: &[(usize, Rc<Vec<u8>>)]| all.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>();
            while self.decoded.len() == KEPT || kept(&self.decoded) > self.max - size {
                self.decoded.remove(0);
            }
            let bytes = Rc::new(self.decode(root, packed, &part(), context)?);
            self.decoded.push((index, Rc::clone(&bytes)));
            return Ok(ViewBytes::Decoded(bytes));
        }
        self.range(root, view.buffer, (view.byte_offset, view.byte_length), &part(), context)
    }

    /// A checked part of a buffer.
    fn range(
        &mut self,
        root: &Root,
        buffer: usize,
        (offset, length): (u64, u64),
        part: &str,
        context: &Context<'_>,
    ) -> Result<ViewBytes, ReadError> {
        let there = self.open(root, buffer, part, context)?;
        if offset.checked_add(length).is_none_or(|end| end > there) {
            let found = format!(
                "{} from byte {offset} of buffers[{buffer}], which has {there}",
                counted(length, "byte", "bytes")
            );
            return Err(context.part(part.to_owned(), found, "bytes that are there; copy or export the file again"));
        }
        Ok(ViewBytes::Stored(buffer, offset, length))
    }

    /// Open a buffer; how many bytes it has.
    fn open(&mut self, root: &Root, index: usize, by: &str, context: &Context<'_>) -> Result<u64, ReadError> {
        let Some(slot) = self.stores.get_mut(index) else {
            let found = format!("buffers[{index}], but there are {}", root.buffers.len());
            return Err(context.part(by.to_owned(), found, "a buffer of this file"));
        };
        if slot.is_none() {
            let store = if let Some(uri) = &root.buffers[index].uri {
                open_uri(uri, &format!("buffers[{index}]"), context)?
            } else if let Some((offset, length)) = self.binary.filter(|_| index == 0) {
                Store::Inside(offset, length)
            } else {
                let found = "neither a uri nor a binary chunk for it".to_owned();
                return Err(context.part(format!("buffers[{index}]"), found, "the bytes of the buffer"));
            };
            if let Store::Beside(_, length) = &store {
                self.total += length;
            }
            *slot = Some(store);
        }
        Ok(match slot {
            Some(Store::Inside(_, length) | Store::Beside(_, length)) => *length,
            Some(Store::Memory(bytes)) => bytes.len() as u64,
            None => 0,
        })
    }

    /// `length` bytes of a view from `offset`, which the caller has checked to lie in it, in place of what `into` has.
    pub(super) fn read(
        &mut self,
        view: &ViewBytes,
        offset: u64,
        length: usize,
        into: &mut Vec<u8>,
        context: &Context<'_>,
    ) -> Result<(), ReadError> {
        into.clear();
        match view {
            ViewBytes::Decoded(bytes) => {
                let from = offset as usize;
                into.extend_from_slice(bytes.get(from..from + length).unwrap_or_default());
            }
            ViewBytes::Stored(buffer, first, _) => {
                let at = first + offset;
                let io = |source| ReadError::Io { file: context.path.to_owned(), offset: at, source };
                match self.stores.get_mut(*buffer) {
                    Some(Some(Store::Inside(start, _))) => {
                        self.source.seek(SeekFrom::Start(*start + at)).map_err(io)?;
                        (&mut *self.source).take(length as u64).read_to_end(into).map_err(io)?;
                    }
                    Some(Some(Store::Beside(file, _))) => {
                        use std::io::Seek;
                        file.seek(SeekFrom::Start(at)).map_err(io)?;
                        file.take(length as u64).read_to_end(into).map_err(io)?;
                    }
                    Some(Some(Store::Memory(bytes))) => {
                        let from = at as usize;
                        into.extend_from_slice(bytes.get(from..from + length).unwrap_or_default());
                    }
                    _ => {}
                }
                self.done += length as u64;
            }
        }
        if into.len() != length {
            let source = std::io::ErrorKind::UnexpectedEof.into();
            return Err(ReadError::Io { file: context.path.to_owned(), offset, source });
        }
        if self.done - self.reported >= 1 << 20 {
            self.reported = self.done;
            (self.progress)(self.done.min(self.total), self.total);
        }
        Ok(())
    }

    /// All bytes of a view.
    pub(super) fn whole(&mut self, view: &ViewBytes, context: &Context<'_>) -> Result<Vec<u8>, ReadError> {
        let mut bytes = Vec::new();
        self.read(view, 0, view.len() as usize, &mut bytes, context)?;
        Ok(bytes)
    }

    /// Decode a view of `EXT_meshopt_compression` (Kapoulkine, Lalish and others, glTF extension, 2020) or
    /// `KHR_meshopt_compression`.
    fn decode(
        &mut self,
        root: &Root,
        packed: &Meshopt,
        part: &str,
        context: &Context<'_>,
    ) -> Result<Vec<u8>, ReadError> {
        let view = self.range(root, packed.buffer, (packed.byte_offset, packed.byte_length), part, context)?;
        let source = self.whole(&view, context)?;
        let bad = |found: String| context.part(part.to_owned(), found, "a sound meshopt stream; export the file again");
        let size = |n: u64| usize::try_from(n).map_err(|_| bad(format!("{n} elements or bytes")));
        let (count, stride) = (size(packed.count)?, size(packed.byte_stride)?);
        let mut work = meshoptimizer_rs::Workspace::default();
        let decoded = match packed.mode.as_str() {
            "ATTRIBUTES" => codec::decode_vertex_buffer(count, stride, &source, &mut work),
            "TRIANGLES" => codec::decode_index_buffer(count, stride, &source, &mut work),
            "INDICES" => codec::decode_index_sequence(count, stride, &source, &mut work),
            other => return Err(bad(format!("the mode \"{other}\""))),
        };
        let mut bytes = decoded.map_err(|e| bad(e.to_string()))?;
        match packed.filter.as_deref() {
            None | Some("NONE") => Ok(()),
            Some("OCTAHEDRAL") => codec::decode_filter_oct(&mut bytes, count, stride, &mut work),
            Some("QUATERNION") => codec::decode_filter_quat(&mut bytes, count, stride, &mut work),
            Some("EXPONENTIAL") => codec::decode_filter_exp(&mut bytes, count, stride, &mut work),
            Some("COLOR") => codec::decode_filter_color(&mut bytes, count, stride, &mut work),
            Some(other) => return Err(bad(format!("the filter \"{other}\""))),
        }
        .map_err(|e| bad(e.to_string()))?;
        Ok(bytes)
    }
}

/// The bytes of a data URI; `None` where it is another URI.
pub(super) fn data_uri(uri: &str, part: &str, context: &Context<'_>) -> Result<Option<Vec<u8>>, ReadError> {
    let Some(rest) = uri.strip_prefix(DATA) else { return Ok(None) };
    let bad = |found: &str| context.part(part.to_owned(), found.to_owned(), "a data URI in base64");
    let (about, data) = rest.split_once(',').ok_or_else(|| bad("a data URI without a comma"))?;
    if !about.ends_with(";base64") {
        return Ok(Some(percent_decode_str(data).collect()));
    }
    let bytes =
        BASE64.decode(data.trim_ascii()).map_err(|e| bad(&format!("a data URI that is not valid base64 ({e})")))?;
    Ok(Some(bytes))
}

/// Whether the bytes are in the URI itself.
pub(super) fn is_data(uri: &str) -> bool {
    uri.starts_with(DATA)
}

/// Where a URI that names a file leads. Some exporters do not escape: the name as it stands counts where there is such a
/// file. What is escaped is resolved once.
pub(super) fn find(uri: &str, context: &Context<'_>) -> Found {
    let companions = context.companions;
    let plain = companions.find(companions.folder(), uri);
    if matches!(plain, Found::File(_)) {
        return plain;
    }
    match companions.find(companions.folder(), &percent_decode_str(uri).decode_utf8_lossy()) {
        Found::Nothing => plain,
        found => found,
    }
}

/// The file that a URI names.
///
/// # Errors
/// [`ReadError::Part`] where it is an address or does not exist, [`ReadError::Outside`] where it must not be read.
pub(super) fn locate(uri: &str, part: &str, context: &Context<'_>) -> Result<PathBuf, ReadError> {
    let web = |scheme: &str| scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric());
    if uri.split_once("://").is_some_and(|(scheme, _)| web(scheme)) {
        let found = format!("the address \"{}\"", shown(uri));
        return Err(context.part(part.to_owned(), found, "a file beside the glTF; download it and name it there"));
    }
    match find(uri, context) {
        Found::File(path) => Ok(path),
        Found::Outside(target) => {
            Err(context.companions.refusal(&Reference { file: context.path, place: part, name: uri }, target))
        }
        Found::Nothing => Err(missing(uri, "is not there", part, context)),
    }
}

fn missing(uri: &str, why: &str, part: &str, context: &Context<'_>) -> ReadError {
    let found = format!("the file \"{}\", which {why}", shown(&percent_decode_str(uri).decode_utf8_lossy()));
    context.part(part.to_owned(), found, "all files that the glTF names beside it; copy them too")
}

fn shown(uri: &str) -> String {
    visible(&uri.chars().take(80).collect::<String>()).into_owned()
}

fn open_uri(uri: &str, part: &str, context: &Context<'_>) -> Result<Store, ReadError> {
    if let Some(bytes) = data_uri(uri, part, context)? {
        return Ok(Store::Memory(Rc::new(bytes)));
    }
    let path = locate(uri, part, context)?;
    let cannot = |e: std::io::Error| missing(uri, &format!("cannot be opened ({e})"), part, context);
    let (file, length) = context.companions.open(&path).map_err(cannot)?;
    Ok(Store::Beside(file, length))
}
