-- What is kept whatever its age, and what was removed by age. Both are views of the log, held against it by verify.

-- Jobs on hold. event is the job-held that put it there.
CREATE TABLE holds (
    job   INTEGER PRIMARY KEY REFERENCES jobs (id),
    at_ns INTEGER NOT NULL,
    who   TEXT    NOT NULL,
    why   TEXT    NOT NULL,
    event INTEGER NOT NULL
) STRICT;

CREATE TRIGGER holds_begin_with_an_event BEFORE INSERT ON holds
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'job-held'
                 AND json_extract(detail, '$.job') = NEW.job)
BEGIN SELECT RAISE(ABORT, 'a job is held with its event only'); END;

CREATE TRIGGER holds_stay BEFORE UPDATE ON holds
BEGIN SELECT RAISE(ABORT, 'holds cannot be changed'); END;

CREATE TRIGGER holds_end_with_an_event BEFORE DELETE ON holds
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence > OLD.event AND kind = 'job-released'
                 AND json_extract(detail, '$.job') = OLD.job)
BEGIN SELECT RAISE(ABORT, 'a job is released with its event only'); END;

-- Record files that retention removes (marked) or has removed (removed). The catalogue row stays, the roll-up stays.
CREATE TABLE removals (
    record        INTEGER PRIMARY KEY REFERENCES records (sequence),
    state         TEXT    NOT NULL CHECK (state IN ('marked', 'removed')),
    at_ns         INTEGER NOT NULL,
    why           TEXT    NOT NULL,
    rollup_sha256 TEXT,
    event         INTEGER NOT NULL
) STRICT;

CREATE TRIGGER removals_begin_with_an_event BEFORE INSERT ON removals
WHEN NEW.state IS NOT 'marked'
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'record-removal-begun'
                 AND json_extract(detail, '$.record') = NEW.record)
BEGIN SELECT RAISE(ABORT, 'a record is removed with its event only'); END;

-- A file cannot be removed whose job was put on hold meanwhile.
CREATE TRIGGER removals_spare_holds BEFORE INSERT ON removals
WHEN EXISTS (SELECT 1 FROM holds JOIN records USING (job) WHERE records.sequence = NEW.record)
BEGIN SELECT RAISE(ABORT, 'a record of a job on hold is not removed'); END;

CREATE TRIGGER removals_end_once BEFORE UPDATE ON removals
WHEN OLD.state IS NOT 'marked' OR NEW.state IS NOT 'removed' OR NEW.record IS NOT OLD.record OR NEW.event <= OLD.event
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'record-removed'
                 AND json_extract(detail, '$.record') = NEW.record)
BEGIN SELECT RAISE(ABORT, 'a removal ends with its event only'); END;

CREATE TRIGGER removals_are_kept BEFORE DELETE ON removals
WHEN OLD.state IS NOT 'marked'
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence > OLD.event AND kind = 'record-removal-withdrawn'
                 AND json_extract(detail, '$.record') = OLD.record)
BEGIN SELECT RAISE(ABORT, 'a removal is withdrawn with its event only'); END;

CREATE INDEX records_by_machine ON records (machine, first_us);
