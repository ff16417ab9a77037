//! The attribute names of ISO 14649 entities by position, as parts 10, 11, 12, 111 and 121 list them.
//!
//! Only for showing: what runs a program is found by the kind of what an attribute refers to, because the editions of the standard
//! differ in the positions.

/// Attributes of an operation behind toolpath, tool direction, identifier, retract plane, start point, tool, technology and functions.
pub(super) const OPERATION_TAILS: &[(&str, &[&str])] = &[
    ("FREEFORM_OPERATION", &["overcut length", "approach", "retract", "strategy"]),
    ("PLANE_ROUGH_MILLING", PLANE),
    ("PLANE_FINISH_MILLING", PLANE),
    ("SIDE_ROUGH_MILLING", SIDE),
    ("SIDE_FINISH_MILLING", SIDE),
    ("BOTTOM_AND_SIDE_ROUGH_MILLING", BOTTOM_AND_SIDE),
    ("BOTTOM_AND_SIDE_FINISH_MILLING", BOTTOM_AND_SIDE),
    ("DRILLING", DRILLING),
    ("CENTER_DRILLING", DRILLING),
    ("COUNTER_SINKING", DRILLING),
    (
        "MULTISTEP_DRILLING",
        &[
            "overcut length",
            "cutting depth",
            "previous diameter",
            "dwell time bottom",
            "feed on retract",
            "strategy",
            "retract distance",
            "first depth",
            "depth of step",
            "dwell time step",
        ],
    ),
    ("BORING", BORING),
    ("REAMING", BORING),
    (
        "TAPPING",
        &[
            "overcut length",
            "cutting depth",
            "previous diameter",
            "dwell time bottom",
            "feed on retract",
            "strategy",
            "compensation chuck",
        ],
    ),
    (
        "THREAD_DRILLING",
        &[
            "overcut length",
            "cutting depth",
            "previous diameter",
            "dwell time bottom",
            "feed on retract",
            "strategy",
            "helical movement on forward",
        ],
    ),
    ("FACING_ROUGH", TURNING),
    ("FACING_FINISH", TURNING),
    ("CONTOURING_ROUGH", TURNING),
    ("CONTOURING_FINISH", TURNING),
    ("GROOVING_ROUGH", TURNING),
    ("GROOVING_FINISH", TURNING),
    ("CUTTING_IN", TURNING),
];

const PLANE: &[&str] = &[
    "overcut length",
    "approach",
    "retract",
    "strategy",
    "axial cutting depth",
    "allowance bottom",
];
const SIDE: &[&str] = &[
    "overcut length",
    "approach",
    "retract",
    "strategy",
    "axial cutting depth",
    "radial cutting depth",
    "allowance side",
];
const BOTTOM_AND_SIDE: &[&str] = &[
    "overcut length",
    "approach",
    "retract",
    "strategy",
    "axial cutting depth",
    "radial cutting depth",
    "allowance side",
    "allowance bottom",
];
const DRILLING: &[&str] = &[
    "overcut length",
    "cutting depth",
    "previous diameter",
    "dwell time bottom",
    "feed on retract",
    "strategy",
];
const BORING: &[&str] = &[
    "overcut length",
    "cutting depth",
    "previous diameter",
    "dwell time bottom",
    "feed on retract",
    "strategy",
    "spindle stop at bottom",
    "depth of test cut",
    "waiting position",
];
const TURNING: &[&str] = &["approach", "retract", "strategy", "allowance"];

/// Attributes of a feature behind identifier, workpiece, operations, placement and depth.
pub(super) const FEATURE_TAILS: &[(&str, &[&str])] = &[
    (
        "PLANAR_FACE",
        &["course of travel", "removal boundary", "face boundary", "bosses"],
    ),
    ("ROUND_HOLE", &["diameter", "change in diameter", "bottom condition"]),
    (
        "CLOSED_POCKET",
        &[
            "bosses",
            "slope",
            "bottom condition",
            "planar radius",
            "orthogonal radius",
            "boundary",
        ],
    ),
    (
        "OPEN_POCKET",
        &[
            "bosses",
            "slope",
            "bottom condition",
            "planar radius",
            "orthogonal radius",
            "open boundary",
            "wall boundary",
        ],
    ),
    ("SLOT", &["course of travel", "swept shape", "end conditions"]),
    ("STEP", &["open boundary", "wall boundary", "bosses"]),
    ("TOOLPATH_FEATURE", &[]),
];

/// Attributes of the body of a tool behind its dimensions.
pub(super) const BODY: &[&str] = &[
    "number of effective teeth",
    "hand of cut",
    "coolant through tool",
    "pilot length",
];

/// Attributes of MILLING_TOOL_DIMENSION with their units.
pub(super) const DIMENSION: &[(&str, &str)] = &[
    ("effective cutting diameter", "mm"),
    ("tool top angle", "deg"),
    ("tool circumference angle", "deg"),
    ("cutting edge length", "mm"),
    ("edge radius", "mm"),
    ("edge center vertical", "mm"),
    ("edge center horizontal", "mm"),
];

/// The unit of an attribute that is written as a bare number.
pub(super) fn unit_of(name: &str) -> &'static str {
    match name {
        "dwell time bottom" | "dwell time step" => "s",
        "slope" => "deg",
        "feed on retract" | "number of effective teeth" => "",
        _ => "mm",
    }
}
