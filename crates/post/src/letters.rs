//! Text for people, in the letters that a control has: names of parts come with umlauts, brackets, percent signs and line breaks, and
//! each of them can end a comment, a program or a transmission.

/// What a control does with text in comments and messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Letters {
    /// Small letters are written as capital ones.
    pub capitals: bool,
    /// Characters that mean something to the control and what stands for each.
    pub instead: &'static [(char, &'static str)],
}

impl Letters {
    /// The text in the control's letters, on one line. A letter that nothing stands for becomes a question mark.
    pub fn write(&self, text: &str) -> String {
        let mut out = String::with_capacity(text.len());
        for letter in text.chars() {
            if let Some((_, stand_in)) = self.instead.iter().find(|(c, _)| *c == letter) {
                out.push_str(stand_in);
                continue;
            }
            match letter {
                ' '..='~' => out.push(letter),
                _ if letter.is_whitespace() || letter.is_control() => out.push(' '),
                _ => out.push_str(plain(letter)),
            }
        }
        if self.capitals {
            out.make_ascii_uppercase();
        }
        out.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

/// The usual spelling of a letter in ASCII.
fn plain(letter: char) -> &'static str {
    match letter {
        'ä' | 'æ' => "ae",
        'ö' | 'œ' => "oe",
        'ü' => "ue",
        'Ä' | 'Æ' => "Ae",
        'Ö' | 'Œ' => "Oe",
        'Ü' => "Ue",
        'ß' => "ss",
        'à' | 'á' | 'â' | 'ã' | 'å' => "a",
        'è' | 'é' | 'ê' | 'ë' => "e",
        'ì' | 'í' | 'î' | 'ï' => "i",
        'ò' | 'ó' | 'ô' | 'õ' => "o",
        'ø' => "oe",
        'ù' | 'ú' | 'û' => "u",
        'ç' => "c",
        'ñ' => "n",
        'š' => "s",
        'ž' => "z",
        'č' | 'ć' => "c",
        'ř' => "r",
        'ł' => "l",
        'À' | 'Á' | 'Â' | 'Ã' | 'Å' => "A",
        'È' | 'É' | 'Ê' | 'Ë' => "E",
        'Ø' => "Oe",
        'Ç' => "C",
        'Ñ' => "N",
        'Š' => "S",
        'Ž' => "Z",
        'Č' | 'Ć' => "C",
        '⌀' | '∅' => "D",
        '°' => "deg",
        '±' => "+-",
        'µ' | 'μ' => "u",
        '×' => "x",
        '–' | '—' | '−' | '‐' | '‑' => "-",
        '‘' | '’' | '‚' => "'",
        '“' | '”' | '„' => "'",
        '…' => "...",
        '²' => "2",
        '³' => "3",
        '½' => "1/2",
        '€' => "EUR",
        _ => "?",
    }
}

/// The text in pieces of at most `most` characters, cut between words where there are any.
pub fn pieces(text: &str, most: usize) -> Vec<String> {
    let most = most.max(1);
    let mut all = Vec::new();
    let mut line = String::new();
    for word in text.split(' ').filter(|word| !word.is_empty()) {
        let mut word = word;
        if !line.is_empty() && line.len() + 1 + word.len() > most {
            all.push(std::mem::take(&mut line));
        }
        // ASCII by now: bytes are characters.
        while word.len() > most {
            let (head, rest) = word.split_at(most);
            all.push(head.to_owned());
            word = rest;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    if !line.is_empty() || all.is_empty() {
        all.push(line);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_name_ends_a_comment_or_a_program() {
        let fanuc = Letters {
            capitals: true,
            instead: &[('(', "["), (')', "]"), ('%', " PCT"), (';', ",")],
        };
        assert_eq!(
            fanuc.write("Größe (alt) 80 %;\nM30\r\n☃ ⌀8"),
            "GROESSE [ALT] 80 PCT, M30 ? D8"
        );
        assert_eq!(fanuc.write(" \t\n"), "");
    }

    #[test]
    fn long_text_is_cut_between_words_and_long_words_inside() {
        assert_eq!(pieces("one two three", 7), ["one two", "three"]);
        assert_eq!(pieces("abcdefgh ij", 3), ["abc", "def", "gh", "ij"]);
        assert_eq!(pieces("", 5), [""]);
    }
}
