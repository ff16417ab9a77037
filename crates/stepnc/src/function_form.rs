//! The two ways in which ISO 10303-238 writes an extended NC function. Its mapping table (5.1.6.5) and the local rules of its AIM (WR1, WR8
//! of machining_nc_function) contradict each other; readers here take either.

/// How an extended NC function is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FunctionForm {
    /// As the mapping table says, which is what toolkits follow: `extended function`, `description`.
    #[default]
    Mapping,
    /// As the AIM's local rules admit it: `legacy function`, `function text`.
    AimStrict,
}

impl FunctionForm {
    /// The description of the MACHINING_NC_FUNCTION.
    pub(crate) const fn kind(self) -> &'static str {
        match self {
            FunctionForm::Mapping => "extended function",
            FunctionForm::AimStrict => "legacy function",
        }
    }

    /// The name of the property that holds its text.
    pub(crate) const fn property(self) -> &'static str {
        match self {
            FunctionForm::Mapping => "description",
            FunctionForm::AimStrict => "function text",
        }
    }
}
