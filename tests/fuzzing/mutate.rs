//! Mutations of files, for binary formats as well as for text: bits, bytes, runs, numbers of either kind, words of other
//! inputs. Deterministic: the same seed and inputs give the same sequence.

/// No input is longer.
pub(crate) const MAX_BYTES: usize = 1 << 16;

/// Bytes that change what parsers do.
const BYTES: [u8; 14] = [0, 1, 0x7f, 0x80, 0xff, b'\n', b' ', b'-', b'.', b'e', b'"', b'{', b'[', b'/'];
/// Limits of number types.
const NUMBERS: [u64; 12] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7f80_0000, // infinity as a float
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
];
/// The same in text.
const WORDS: [&str; 16] = [
    "0",
    "-1",
    "1",
    "3",
    "255",
    "65536",
    "2147483648",
    "4294967295",
    "-4294967297",
    "18446744073709551616",
    "1e39",
    "-1e-400",
    "nan",
    "inf",
    "0x10",
    "",
];

/// Makes inputs from inputs.
pub(crate) struct Mutator {
    random: fastrand::Rng,
    inputs: Vec<Vec<u8>>,
}

impl Mutator {
    pub(crate) fn new(seed: u64, inputs: Vec<Vec<u8>>) -> Self {
        Self { random: fastrand::Rng::with_seed(seed), inputs }
    }

    /// How many inputs there are to begin with.
    pub(crate) fn len(&self) -> usize {
        self.inputs.len()
    }

    /// Begin also with this one from now on.
    pub(crate) fn keep(&mut self, input: Vec<u8>) {
        self.inputs.push(input);
    }

    fn below(&mut self, n: usize) -> usize {
        self.random.usize(..n.max(1))
    }

    /// The next input: one of those there are, changed one to eight times.
    pub(crate) fn next(&mut self) -> Vec<u8> {
        let pick = self.below(self.inputs.len());
        let mut bytes = self.inputs[pick].clone();
        for _ in 0..1 << self.below(4) {
            self.change(&mut bytes);
        }
        bytes.truncate(MAX_BYTES);
        bytes
    }

    fn change(&mut self, bytes: &mut Vec<u8>) {
        let at = self.below(bytes.len());
        let run = |s: &mut Self, n: usize| at..at + s.below((n - at).min(64)).max(1).min(n - at);
        match self.below(11) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << self.below(8),
            1 if !bytes.is_empty() => bytes[at] = self.random.u8(..),
            2 if !bytes.is_empty() => bytes[at] = BYTES[self.below(BYTES.len())],
            3 => bytes.insert(at, BYTES[self.below(BYTES.len())]),
            4 if !bytes.is_empty() => drop(bytes.drain(run(self, bytes.len()))),
            5 if !bytes.is_empty() => {
                let copy = bytes[run(self, bytes.len())].to_vec();
                let to = self.below(bytes.len());
                bytes.splice(to..to, copy);
            }
            6 if bytes.len() >= 8 => self.number(bytes),
            7 => self.word(bytes),
            8 | 9 => self.borrow(bytes),
            10 if self.below(4) == 0 => bytes.truncate(at),
            _ => bytes.push(self.random.u8(..)),
        }
    }

    /// A binary number becomes another one.
    fn number(&mut self, bytes: &mut [u8]) {
        let size = [1, 2, 4, 8][self.below(4)];
        let at = self.below(bytes.len() - size + 1);
        let mut value = NUMBERS[self.below(NUMBERS.len())];
        if self.below(3) == 0 {
            value = (bytes.len() as u64).wrapping_add(self.below(5) as u64).wrapping_sub(2);
        }
        let mut little = value.to_le_bytes();
        if self.below(4) == 0 {
            little[..size].reverse();
        }
        bytes[at..at + size].copy_from_slice(&little[..size]);
    }

    /// A word of text becomes the limit of a number type.
    fn word(&mut self, bytes: &mut Vec<u8>) {
        let Some(range) = self.word_of(bytes) else { return };
        let word = WORDS[self.below(WORDS.len())];
        bytes.splice(range, word.bytes());
    }

    /// A word, or a run of bytes, of another input comes into this one.
    fn borrow(&mut self, bytes: &mut Vec<u8>) {
        let pick = self.below(self.inputs.len());
        let other = std::mem::take(&mut self.inputs[pick]);
        let from = if self.below(2) == 0 {
            self.word_of(&other)
        } else {
            let at = self.below(other.len());
            Some(at..at + self.below((other.len() - at).min(200)))
        };
        if let Some(from) = from {
            let at = self.below(bytes.len());
            let to = match self.below(3) {
                0 => at..at,
                1 => at..(at + from.len()).min(bytes.len()),
                _ => self.word_of(bytes).unwrap_or(at..at),
            };
            bytes.splice(to, other[from].iter().copied());
        }
        self.inputs[pick] = other;
    }

    /// A word at or after a random place.
    fn word_of(&mut self, bytes: &[u8]) -> Option<std::ops::Range<usize>> {
        let is_word = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'-' | b'+' | b'.');
        let from = self.below(bytes.len());
        let start = from + bytes[from..].iter().position(is_word)?;
        let length = bytes[start..].iter().take(64).position(|b| !is_word(b)).unwrap_or(1);
        Some(start..start + length)
    }
}
