-- Operators and what they have learned. A view of the log, held against it by verify. A row is never deleted: an operator whose level was
-- taken away has none (NULL), and the log still says what was done under the name.
CREATE TABLE operators (
    name               TEXT    PRIMARY KEY,
    level              INTEGER CHECK (level BETWEEN 1 AND 10),
    experience         TEXT    NOT NULL,
    organization       TEXT    NOT NULL,
    role               TEXT    NOT NULL,
    shift              TEXT    NOT NULL,
    qualified_until_ns INTEGER,
    assigned_by        TEXT    NOT NULL,
    event              INTEGER NOT NULL -- operator-assigned, of log 0
) STRICT, WITHOUT ROWID;

CREATE TRIGGER operators_come_with_an_event BEFORE INSERT ON operators
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'operator-assigned'
                 AND json_extract(detail, '$.operator') = NEW.name)
BEGIN SELECT RAISE(ABORT, 'an operator is made with an event only'); END;

CREATE TRIGGER operators_change_with_an_event BEFORE UPDATE ON operators
WHEN NEW.name IS NOT OLD.name OR NEW.event <= OLD.event
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'operator-assigned'
                 AND json_extract(detail, '$.operator') = NEW.name)
BEGIN SELECT RAISE(ABORT, 'an operator changes with an event only'); END;

CREATE TRIGGER operators_are_kept BEFORE DELETE ON operators
BEGIN SELECT RAISE(ABORT, 'operators cannot be deleted'); END;
