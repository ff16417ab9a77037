-- Sizing. What was declared and what was entered are events of the directory's chain; these tables find them again. They only grow.

-- A job whose sizes are entered. text is the job file as it was loaded; the newest of a machine is in force.
CREATE TABLE sizing_jobs (
    event     INTEGER PRIMARY KEY, -- size-job, of log 0
    machine   TEXT    NOT NULL,
    diameters TEXT    NOT NULL,    -- the axes whose registers count diameters: 'x'
    name      TEXT    NOT NULL,
    text      TEXT    NOT NULL
) STRICT;

-- One entry, refusal, undo, finding or new tool.
CREATE TABLE sizing_entries (
    event     INTEGER PRIMARY KEY, -- size-..., of log 0: who, when, why, part, before, after stand there
    job       INTEGER NOT NULL REFERENCES sizing_jobs (event),
    dimension TEXT    NOT NULL
) STRICT;
CREATE INDEX sizing_entries_by_job ON sizing_entries (job, event);

CREATE TRIGGER sizing_jobs_have_their_event BEFORE INSERT ON sizing_jobs
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind = 'size-job')
BEGIN SELECT RAISE(ABORT, 'a sizing job comes with its event only'); END;

CREATE TRIGGER sizing_jobs_stay BEFORE UPDATE ON sizing_jobs
BEGIN SELECT RAISE(ABORT, 'sizing jobs cannot be changed'); END;

CREATE TRIGGER sizing_jobs_are_kept BEFORE DELETE ON sizing_jobs
BEGIN SELECT RAISE(ABORT, 'sizing jobs cannot be deleted'); END;

CREATE TRIGGER sizing_entries_have_their_event BEFORE INSERT ON sizing_entries
WHEN NOT EXISTS (SELECT 1 FROM events WHERE log = 0 AND sequence = NEW.event AND kind LIKE 'size-%'
                 AND json_extract(detail, '$.dimension') = NEW.dimension)
BEGIN SELECT RAISE(ABORT, 'an entry comes with its event only'); END;

CREATE TRIGGER sizing_entries_stay BEFORE UPDATE ON sizing_entries
BEGIN SELECT RAISE(ABORT, 'entries cannot be changed'); END;

CREATE TRIGGER sizing_entries_are_kept BEFORE DELETE ON sizing_entries
BEGIN SELECT RAISE(ABORT, 'entries cannot be deleted'); END;
