//! PDF and TIFF: bands deflated and written as they come. What stands between them is [`kilwa_measure::sheet::file`]'s, which the page has too.

use super::Next;
use anyhow::Context;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use kilwa_measure::sheet::file::Writer;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};

pub(super) fn write(file: &mut File, width: u32, mut writer: Writer, next: Next<'_>) -> anyhow::Result<()> {
    let failed = "cannot write the drawing";
    let mut out = BufWriter::new(file);
    while let Some(rows) = next()? {
        let count = (rows.len() / (width as usize * 3)) as u32;
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(&rows)?;
        let packed = packed.finish()?;
        out.write_all(&writer.strip(count, packed.len() as u64)?).context(failed)?;
        out.write_all(&packed).context(failed)?;
    }
    let ending = writer.end()?;
    out.write_all(&ending.tail).context(failed)?;
    if let Some(head) = ending.head {
        out.seek(SeekFrom::Start(0)).context(failed)?;
        out.write_all(&head).context(failed)?;
    }
    out.flush().context(failed)
}
