-- What is known of the content of program files, by where they lie: from an edit, or from a cycle start. A view of the log, held against
-- it by verify. A file whose hash is another one at the next cycle start was edited outside.
CREATE TABLE programs (
    path   TEXT    PRIMARY KEY,
    sha256 TEXT    NOT NULL,
    event  INTEGER NOT NULL -- program-edited, program-known or program-changed-outside, of log 0
) STRICT, WITHOUT ROWID;

CREATE TRIGGER programs_come_with_an_event BEFORE INSERT ON programs
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event
                 AND kind IN ('program-edited', 'program-known', 'program-changed-outside')
                 AND json_extract(detail, '$.path') = NEW.path AND json_extract(detail, '$.sha256') = NEW.sha256)
BEGIN SELECT RAISE(ABORT, 'a program is known by its event only'); END;

CREATE TRIGGER programs_change_with_an_event BEFORE UPDATE ON programs
WHEN NEW.path IS NOT OLD.path OR NEW.event <= OLD.event
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event
                 AND kind IN ('program-edited', 'program-known', 'program-changed-outside')
                 AND json_extract(detail, '$.path') = NEW.path AND json_extract(detail, '$.sha256') = NEW.sha256)
BEGIN SELECT RAISE(ABORT, 'a program is known by its event only'); END;

CREATE TRIGGER programs_are_kept BEFORE DELETE ON programs
BEGIN SELECT RAISE(ABORT, 'what is known of programs cannot be deleted'); END;
