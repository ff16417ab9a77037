//! Whole programs for other controls: one file per control, and what each can do of the traceability functions.
