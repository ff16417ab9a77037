-- Version 1. Times are nanoseconds since 1970 UTC, hashes are 64 hexadecimal digits, folders and paths are relative to the data
-- directory where they lie in it.

-- One run of one program. A view for people and lists: what matters of it is told by the events job-started and job-ended.
CREATE TABLE jobs (
    id             INTEGER PRIMARY KEY AUTOINCREMENT,
    program        TEXT    NOT NULL,
    program_sha256 TEXT    NOT NULL,
    machine        TEXT    NOT NULL,
    seed           TEXT    NOT NULL, -- decimal: SQLite has no unsigned 64-bit integers
    start_ns       INTEGER NOT NULL,
    end_ns         INTEGER,
    state          TEXT    NOT NULL CHECK (state IN ('running', 'done', 'failed', 'interrupted')),
    folder         TEXT    NOT NULL
) STRICT;

-- The chained log. log 0 is the data directory's own chain; a job's events are a chain of their own under the job's id, so that the
-- same run gives the same events whatever happened in this folder before. job-ended ties a job's chain to the directory's.
CREATE TABLE events (
    log      INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    at_ns    INTEGER NOT NULL,
    kind     TEXT    NOT NULL,
    detail   TEXT    NOT NULL CHECK (json_valid(detail)),
    previous TEXT    NOT NULL,
    hash     TEXT    NOT NULL,
    PRIMARY KEY (log, sequence)
) STRICT, WITHOUT ROWID;

-- Before an insert and not a constraint only: INSERT OR REPLACE resolves constraints by deleting.
CREATE TRIGGER events_follow_each_other BEFORE INSERT ON events
WHEN NEW.sequence IS NOT (SELECT coalesce(max(sequence), 0) + 1 FROM events WHERE log = NEW.log)
  OR NEW.previous IS NOT coalesce(
      (SELECT hash FROM events WHERE log = NEW.log ORDER BY sequence DESC LIMIT 1),
      '0000000000000000000000000000000000000000000000000000000000000000')
BEGIN SELECT RAISE(ABORT, 'an event must follow the last one of its chain'); END;

CREATE TRIGGER events_stay BEFORE UPDATE ON events
BEGIN SELECT RAISE(ABORT, 'events cannot be changed'); END;

CREATE TRIGGER events_are_kept BEFORE DELETE ON events
BEGIN SELECT RAISE(ABORT, 'events cannot be deleted'); END;

-- Process values in force: tool and work offsets, settings. The unit stands in the path. event is the change that set the value.
CREATE TABLE registers (
    path  TEXT    PRIMARY KEY,
    value REAL    NOT NULL,
    event INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TRIGGER registers_are_set_by_an_event BEFORE INSERT ON registers
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'change'
                 AND json_extract(detail, '$.path') = NEW.path)
BEGIN SELECT RAISE(ABORT, 'a process value changes with its event only'); END;

CREATE TRIGGER registers_change_by_an_event BEFORE UPDATE ON registers
WHEN NEW.path IS NOT OLD.path OR NEW.event <= OLD.event
  OR NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'change'
                 AND json_extract(detail, '$.path') = NEW.path)
BEGIN SELECT RAISE(ABORT, 'a process value changes with its event only'); END;

CREATE TRIGGER registers_are_kept BEFORE DELETE ON registers
BEGIN SELECT RAISE(ABORT, 'process values cannot be deleted'); END;

-- Record files that are whole. Each row names the hash of the file before it, so that no file can be exchanged or left out unseen.
CREATE TABLE records (
    sequence        INTEGER PRIMARY KEY,
    path            TEXT    NOT NULL,
    job             INTEGER NOT NULL REFERENCES jobs (id),
    machine         TEXT    NOT NULL,
    first_us        INTEGER,
    last_us         INTEGER,
    rows            INTEGER NOT NULL,
    bytes           INTEGER NOT NULL,
    sha256          TEXT    NOT NULL,
    previous_sha256 TEXT    NOT NULL
) STRICT;
CREATE INDEX records_by_job ON records (job);
CREATE INDEX records_by_path ON records (path);

CREATE TRIGGER records_follow_each_other BEFORE INSERT ON records
WHEN NEW.sequence IS NOT (SELECT coalesce(max(sequence), 0) + 1 FROM records)
BEGIN SELECT RAISE(ABORT, 'a record must follow the last one'); END;

CREATE TRIGGER records_stay BEFORE UPDATE ON records
BEGIN SELECT RAISE(ABORT, 'catalogue rows cannot be changed'); END;

CREATE TRIGGER records_are_kept BEFORE DELETE ON records
BEGIN SELECT RAISE(ABORT, 'catalogue rows cannot be deleted'); END;
