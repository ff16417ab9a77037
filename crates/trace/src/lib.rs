//! What the traceability functions of a program mean: read, checked, compiled to watches, recorded.
