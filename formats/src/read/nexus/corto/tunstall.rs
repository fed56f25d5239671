//! Tunstall codes: each byte of the code stands for a word of one or more symbols. The dictionary is not stored; it is
//! rebuilt from the probabilities of the symbols, so the rounding here is part of the format.

use super::super::bytes::{Cursor, Fault};

/// Words of a dictionary: one for each value of a byte.
const WORDS: usize = 256;
/// Runs of the most probable symbol of at least this length are added to the dictionary as a whole.
const LONG_RUN: usize = 16;

/// The entropy codes that a stream can name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entropy {
    /// Symbols as they are.
    Plain,
    /// Tunstall codes.
    Tunstall,
}

/// A coded list of symbols, not yet decoded.
struct Coded<'b> {
    /// Symbol and probability in 1/256.
    symbols: &'b [u8],
    size: usize,
    code: &'b [u8],
    at: u64,
}

impl Entropy {
    /// Decode a list of symbols; a list of more than `max` symbols is refused before memory is allocated.
    pub(super) fn symbols(self, from: &mut Cursor<'_>, max: usize) -> Result<Vec<u8>, Fault> {
        let coded = self.find(from)?;
        if coded.size > max {
            let expected = format!("at most {max}; the file is damaged: copy it again");
            return Err(Fault { at: coded.at, found: format!("{} symbols", coded.size), expected });
        }
        match self {
            Self::Plain => Ok(coded.code.to_vec()),
            Self::Tunstall => coded.decode(),
        }
    }

    /// Skip a list of symbols.
    pub(super) fn skip(self, from: &mut Cursor<'_>) -> Result<(), Fault> {
        self.find(from).map(|_| ())
    }

    fn find<'b>(self, from: &mut Cursor<'b>) -> Result<Coded<'b>, Fault> {
        let at = from.offset();
        if self == Self::Plain {
            let size = from.u32("the number of symbols")? as usize;
            return Ok(Coded { symbols: &[], size, code: from.take(size, "symbols")?, at });
        }
        let n = from.u8("the number of different symbols")?;
        let symbols = from.take(2 * usize::from(n), "the probabilities of symbols")?;
        let size = from.u32("the number of symbols")? as usize;
        let length = from.u32("the length of a code")? as usize;
        Ok(Coded { symbols, size, code: from.take(length, "a code")?, at })
    }
}

impl Coded<'_> {
    fn decode(&self) -> Result<Vec<u8>, Fault> {
        let damaged = |found: String, expected: &str| Fault {
            at: self.at,
            found,
            expected: format!("{expected}; the file is damaged: copy it again"),
        };
        if self.size == 0 {
            return Ok(Vec::new());
        }
        match self.symbols {
            [] => return Err(damaged(format!("{} symbols from an empty alphabet", self.size), "at least one symbol")),
            [symbol, _] => return Ok(vec![*symbol; self.size]),
            _ => {}
        }
        let words = Words::of(self.symbols);
        let mut out = Vec::with_capacity(self.size.min(1 << 16));
        for (i, &byte) in self.code.iter().enumerate() {
            let Some(word) = words.get(byte) else {
                return Err(damaged(format!("code {byte}"), "a code in the dictionary"));
            };
            let remaining = self.size - out.len();
            if word.len() > remaining && i + 1 < self.code.len() {
                return Err(damaged("a longer code".to_owned(), &format!("a code for {} symbols", self.size)));
            }
            out.extend(&word[..word.len().min(remaining)]);
        }
        if out.len() < self.size {
            return Err(damaged(format!("a code for {} symbols", out.len()), &format!("one for {}", self.size)));
        }
        Ok(out)
    }
}

/// A word: the start and number of its symbols, and its probability in 1/65536.
#[derive(Debug, Clone, Copy)]
struct Word {
    start: usize,
    length: usize,
    probability: u32,
}

/// A dictionary under construction. Words are kept in rows by their last symbol; each row is sorted by decreasing probability.
struct Words {
    symbols: Vec<u8>,
    /// Of each symbol, in 1/65536.
    probabilities: Vec<u32>,
    text: Vec<u8>,
    /// Column after column of one word for each symbol.
    queue: Vec<Word>,
    /// The column in which each row begins, as an index into `queue`.
    first: Vec<usize>,
}

fn product(a: u32, b: u32) -> u32 {
    a.wrapping_mul(b) >> 16
}

impl Words {
    /// From at least two pairs of symbol and probability.
    fn of(pairs: &[u8]) -> Dictionary {
        let symbols: Vec<u8> = pairs.iter().copied().step_by(2).collect();
        let probabilities: Vec<u32> = pairs.iter().skip(1).step_by(2).map(|p| u32::from(*p) << 8).collect();
        let n = symbols.len();
        let mut words = Self { symbols, probabilities, text: Vec::new(), queue: Vec::new(), first: (0..n).collect() };
        let run = words.longest_run();
        let count = if run >= LONG_RUN { words.begin_with_run(run) } else { words.begin_with_symbols() };
        words.grow(count);
        words.into_dictionary()
    }

    /// How often the first symbol can be repeated until the run is less probable than the second symbol.
    fn longest_run(&self) -> usize {
        let (p0, p1) = (self.probabilities[0], self.probabilities[1]);
        let max = (WORDS - 1) / (self.symbols.len() - 1);
        let (mut run, mut probability) = (2, product(p0, p0));
        while probability > p1 && run < max {
            probability = product(probability, p0);
            run += 1;
        }
        run
    }

    /// Start with one word for each symbol; returns the number of words.
    fn begin_with_symbols(&mut self) -> usize {
        self.text.clone_from(&self.symbols);
        let word = |(start, p): (usize, &u32)| Word { start, length: 1, probability: *p };
        self.queue = self.probabilities.iter().enumerate().map(word).collect();
        self.symbols.len()
    }

    /// Start with the run of the first symbol, and every shorter run that ends with another symbol; returns the number of words.
    fn begin_with_run(&mut self, run: usize) -> usize {
        let n = self.symbols.len();
        let repeated = self.symbols[0];
        self.text.push(repeated);
        for k in 1..n {
            self.text.extend(std::iter::repeat_n(repeated, run - 1));
            self.text.push(self.symbols[k]);
        }
        let nothing = Word { start: 0, length: 0, probability: 0 };
        self.queue = vec![nothing; run * n];
        let mut before = 0;
        for column in 0..run {
            for row in 1..n {
                let own = self.probabilities[row];
                let probability = if column == 0 { own } else { product(before, own) };
                self.queue[row + column * n] = Word { start: row * run - column, length: column + 1, probability };
            }
            let p0 = self.probabilities[0];
            before = if column == 0 { p0 } else { product(before, p0) };
        }
        self.first[0] = (run - 1) * n;
        self.queue[(run - 1) * n] = Word { start: 0, length: run, probability: before };
        1 + run * (n - 1)
    }

    /// Replace the most probable word by its continuations, until the dictionary is full.
    fn grow(&mut self, mut count: usize) {
        let n = self.symbols.len();
        while count < WORDS {
            let mut best = (0, 0);
            for (row, &first) in self.first.iter().enumerate() {
                let probability = self.queue[first].probability;
                if probability > best.1 {
                    best = (row, probability);
                }
            }
            let word = self.queue[self.first[best.0]];
            let added = n.min(WORDS - count);
            for k in 0..added {
                let (start, length) = (self.text.len(), word.length + 1);
                self.text.extend_from_within(word.start..word.start + word.length);
                self.text.push(self.symbols[k]);
                let probability = product(word.probability, self.probabilities[k]);
                self.queue.push(Word { start, length, probability });
            }
            // The word itself stays if its continuations fill the dictionary.
            if count + n < WORDS {
                self.first[best.0] += n;
            }
            count += n - 1;
        }
    }

    fn into_dictionary(self) -> Dictionary {
        let n = self.symbols.len();
        let is_left = |(i, _): &(usize, &Word)| self.first[i % n] <= *i;
        let words = self.queue.iter().enumerate().filter(is_left).map(|(_, word)| *word).collect();
        Dictionary { text: self.text, words }
    }
}

/// The words in the order of their codes.
struct Dictionary {
    text: Vec<u8>,
    words: Vec<Word>,
}

impl Dictionary {
    fn get(&self, code: u8) -> Option<&[u8]> {
        let word = self.words.get(usize::from(code))?;
        self.text.get(word.start..word.start + word.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A coded list: pairs of symbol and probability, the number of symbols, the code.
    fn stream(pairs: &[[u8; 2]], size: u32, code: &[u8]) -> Vec<u8> {
        let mut bytes = vec![pairs.len() as u8];
        bytes.extend(pairs.iter().flatten());
        bytes.extend(size.to_le_bytes());
        bytes.extend((code.len() as u32).to_le_bytes());
        bytes.extend(code);
        bytes
    }

    fn decoded(bytes: &[u8], max: usize) -> Result<Vec<u8>, Fault> {
        Entropy::Tunstall.symbols(&mut Cursor::new(bytes, 0), max)
    }

    /// 255 symbols leave room for one word beside them: the most probable symbol twice, here the first, 9.
    #[test]
    fn a_dictionary_with_one_word_of_two_symbols_is_rebuilt() {
        let pairs: Vec<[u8; 2]> = (0..255u8).map(|i| [i.wrapping_add(9), if i == 0 { 2 } else { 1 }]).collect();
        let of = |size: u32, code: &[u8]| decoded(&stream(&pairs, size, code), 100);
        assert_eq!(of(4, &[5, 255, 7]).unwrap(), [14, 9, 9, 16]);
        assert_eq!(of(3, &[0, 1, 254]).unwrap(), [9, 10, 7]);
        // The last word may be longer than what is left, no other.
        assert_eq!(of(2, &[1, 255]).unwrap(), [10, 9]);
        assert!(of(2, &[1, 255, 1]).unwrap_err().found.contains("a longer code"));
        assert!(of(5, &[5, 255, 7]).unwrap_err().found.contains("a code for 4 symbols"));
        assert!(of(101, &[5]).unwrap_err().found.contains("101 symbols"));
        let whole = stream(&pairs, 4, &[5, 255, 7]);
        for length in 0..whole.len() {
            assert!(decoded(&whole[..length], 100).is_err(), "{length}");
        }
    }

    #[test]
    fn lists_of_one_kind_and_of_none_have_no_code() {
        assert_eq!(decoded(&stream(&[[7, 255]], 3, &[]), 3).unwrap(), [7, 7, 7]);
        assert!(decoded(&stream(&[], 0, &[]), 3).unwrap().is_empty());
        assert!(decoded(&stream(&[], 1, &[]), 3).unwrap_err().found.contains("from an empty alphabet"));
    }
}
