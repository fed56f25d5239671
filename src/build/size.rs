//! The memory of a build, as people write it.

use kilwa_files::size;

/// The smallest budget that a build accepts: less does not hold one diamond.
pub(crate) const MIN_MEMORY: u64 = 100 << 20;

/// Bytes of memory for a build.
pub(crate) fn memory(text: &str) -> Result<u64, String> {
    let size = size::parse(text)?;
    if size < MIN_MEMORY {
        return Err(format!("{text} is too little for a build; use 100M or more"));
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_build_takes_a_hundred_megabytes_or_more() {
        assert!(super::memory("99M").is_err() && super::memory("100M").is_ok());
    }
}
