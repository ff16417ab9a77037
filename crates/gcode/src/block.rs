//! The words of a block with their values, as they are executed.
//!
//! A [`Block`] is filled again and again from a [`Line`], which knows what the text says; values of variables come in here. Meaning is
//! given to it elsewhere.

use crate::evaluate::{Stack, Variables, evaluate};
use crate::fault::{Fault, Outcome};
use crate::line::{Line, Source};
use crate::macro_b::MacroRules;

/// A word's number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Word {
    pub value: f64,
    pub has_point: bool,
    /// The value was computed: it is rounded to the increment and needs no point.
    pub computed: bool,
    /// The byte of its letter.
    pub at: usize,
}

/// A G or M code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Code {
    /// The number, for G codes times ten.
    pub code: u16,
    /// The byte of its letter.
    pub at: usize,
}

const MOST_CODES: usize = 16;
/// A value beyond nine digits cannot become a fixed-point word: alarm 110.
const LARGEST_WORD: f64 = 999_999_999.0;

/// The parts of a line.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    words: [Word; 26],
    present: u32,
    used: u32,
    g: [Code; MOST_CODES],
    g_count: usize,
    m: [Code; MOST_CODES],
    m_count: usize,
    /// Bytes between the parentheses of the first comment.
    pub comment: Option<(usize, usize)>,
    /// Text behind `;` was left out, from this byte on.
    pub semicolon: Option<usize>,
    /// `,C` or `,R`: a corner's word, by its letter.
    pub corner: Option<(u8, Word)>,
    /// `,A`: the angle of a straight move.
    pub angle: Option<Word>,
    /// A letter that stands twice, and the byte of its second word.
    twice: Option<(u8, usize)>,
}

fn bit(letter: u8) -> u32 {
    1 << (letter - b'A')
}

/// Letters as [`Block::outside`] wants them.
pub(crate) fn set_of(letters: &[u8]) -> u32 {
    letters.iter().fold(0, |set, letter| set | bit(*letter))
}

impl Block {
    pub(crate) fn new() -> Self {
        Block {
            words: [Word::default(); 26],
            present: 0,
            used: 0,
            g: [Code::default(); MOST_CODES],
            g_count: 0,
            m: [Code::default(); MOST_CODES],
            m_count: 0,
            comment: None,
            semicolon: None,
            corner: None,
            angle: None,
            twice: None,
        }
    }

    /// The word of that letter; asking counts as using it.
    #[inline]
    pub(crate) fn take(&mut self, letter: u8) -> Option<Word> {
        self.used |= bit(letter);
        self.look(letter)
    }

    /// The word of that letter, without using it.
    #[inline]
    pub(crate) fn look(&self, letter: u8) -> Option<Word> {
        (self.present & bit(letter) != 0).then(|| self.words[usize::from(letter - b'A')])
    }

    /// True when a word of one of these letters is there.
    pub(crate) fn has_any(&self, letters: &[u8]) -> bool {
        letters.iter().any(|l| self.present & bit(*l) != 0)
    }

    /// Counts all words but these as used.
    pub(crate) fn use_all_but(&mut self, letters: &[u8]) {
        self.used |= !set_of(letters);
    }

    /// The first word that nothing in the block uses.
    pub(crate) fn unused(&self) -> Option<(char, Word)> {
        self.outside(self.used)
    }

    /// Refuses a block in which a letter stands twice.
    pub(crate) fn check_once(&self) -> Outcome<()> {
        match self.twice {
            None => Ok(()),
            Some((letter, at)) => Err(Fault::new(
                at,
                0,
                "word-twice",
                format!("{} stands twice in this block", char::from(letter)),
                "keep one of them, or make two blocks",
            )),
        }
    }

    pub(crate) fn g(&self, index: usize) -> Option<Code> {
        self.g[..self.g_count].get(index).copied()
    }

    /// True when there is an M code.
    pub(crate) fn has_m(&self) -> bool {
        self.m_count > 0
    }

    /// The first word whose letter is not among `letters`, bit 0 for A.
    pub(crate) fn outside(&self, letters: u32) -> Option<(char, Word)> {
        let others = self.present & !letters;
        (others != 0).then(|| {
            let index = others.trailing_zeros() as u8;
            (char::from(b'A' + index), self.words[usize::from(index)])
        })
    }

    pub(crate) fn m_codes(&self) -> ([Code; MOST_CODES], usize) {
        (self.m, self.m_count)
    }

    /// Takes the words of a line, with the values that their variables hold now.
    pub(crate) fn fill<V: Variables>(
        &mut self,
        line: &Line,
        rules: &MacroRules,
        variables: &V,
        stack: &mut Stack,
    ) -> Outcome<()> {
        (self.present, self.used, self.g_count, self.m_count) = (0, 0, 0, 0);
        (self.comment, self.semicolon, self.twice, self.corner) = (line.comment, line.semicolon, None, None);
        self.angle = None;
        for said in &line.words {
            let mut word = Word {
                at: said.at as usize,
                value: 0.0,
                has_point: said.has_point,
                computed: false,
            };
            match said.source {
                Source::Number(value) => word.value = value,
                Source::Expression(expression) => {
                    let value = evaluate(&line.code, expression, rules, variables, stack)?;
                    if value.is_nan() {
                        continue; // vacant: the word is not there
                    }
                    if rules.fanuc_ranges && value.abs() > LARGEST_WORD {
                        return Err(Fault::new(
                            word.at,
                            110,
                            "word-overflow",
                            format!("{value:e} has more digits than a word takes"),
                            "check the value before it is used",
                        ));
                    }
                    word.computed = true;
                    word.value = if matches!(said.letter, b'G' | b'M' | b'S' | b'T') {
                        libm::round(value)
                    } else {
                        value
                    };
                }
            }
            self.put(said.letter, word)?;
        }
        Ok(())
    }

    /// Forgets a word.
    pub(crate) fn drop_word(&mut self, letter: u8) {
        self.present &= !bit(letter);
    }

    /// Forgets an M code.
    pub(crate) fn drop_m(&mut self, code: u16) {
        let mut kept = 0;
        for index in 0..self.m_count {
            if self.m[index].code != code {
                self.m[kept] = self.m[index];
                kept += 1;
            }
        }
        self.m_count = kept;
    }

    /// Forgets a G code.
    pub(crate) fn drop_g(&mut self, code: u16) {
        let mut kept = 0;
        for index in 0..self.g_count {
            if self.g[index].code != code {
                self.g[kept] = self.g[index];
                kept += 1;
            }
        }
        self.g_count = kept;
    }

    /// True when it holds nothing that could be executed.
    pub(crate) fn is_empty(&self) -> bool {
        self.present & !bit(b'N') == 0 && self.g_count + self.m_count == 0
    }

    fn put(&mut self, letter: u8, word: Word) -> Outcome<()> {
        let at = word.at;
        match letter {
            b'G' => {
                let tenfold = libm::round(word.value * 10.0);
                let fits = (0.0..=9999.0).contains(&tenfold) && (tenfold / 10.0 - word.value).abs() < 1e-9;
                let code = if fits { tenfold as u16 } else { u16::MAX };
                push(&mut self.g, &mut self.g_count, Code { code, at })
            }
            b'M' => {
                let fits = (0.0..=9999.0).contains(&word.value) && libm::trunc(word.value) == word.value;
                let code = if fits { word.value as u16 } else { u16::MAX };
                push(&mut self.m, &mut self.m_count, Code { code, at })
            }
            b'a' => {
                self.angle = Some(word);
                Ok(())
            }
            b'b'..=b'z' => {
                self.corner = Some((letter.to_ascii_uppercase(), word));
                Ok(())
            }
            _ => {
                if self.present & bit(letter) != 0 {
                    // Told when the block is executed: the arguments of a macro call may repeat I, J and K.
                    self.twice.get_or_insert((letter, at));
                    return Ok(());
                }
                self.present |= bit(letter);
                self.words[usize::from(letter - b'A')] = word;
                Ok(())
            }
        }
    }
}

fn push(codes: &mut [Code; MOST_CODES], count: &mut usize, code: Code) -> Outcome<()> {
    match codes.get_mut(*count) {
        Some(place) => {
            *place = code;
            *count += 1;
            Ok(())
        }
        None => Err(Fault::new(
            code.at,
            0,
            "too-many-codes",
            format!("more than {MOST_CODES} codes in one block"),
            "make two blocks",
        )),
    }
}
