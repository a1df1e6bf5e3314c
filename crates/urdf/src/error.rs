use spec::{MAX_JOINTS, SpecError};
use thiserror::Error;

use crate::Part;
use crate::part::{listed, shown};

/// Why a text is no URDF of an arm.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum UrdfError {
    /// The text is too long.
    #[error(
        "the URDF has {bytes} bytes, allowed: at most {most}; meshes belong into files of their own"
    )]
    TooLarge {
        /// Bytes of the text.
        bytes: usize,
        /// Bytes that are allowed.
        most: usize,
    },
    /// There are too many elements, or they are nested too deeply.
    #[error("the URDF has more than {most} {what}")]
    TooMany {
        /// The things of which there are too many.
        what: &'static str,
        /// The number that is allowed.
        most: usize,
    },
    /// The text is not well-formed XML.
    #[error("line {line} is not XML: {reason}")]
    NotXml {
        /// Counts from 1.
        line: usize,
        /// The parser's reason.
        reason: String,
    },
    /// The root element is another one.
    #[error("the root element is `{root}`, allowed: `robot`, as in a URDF")]
    NotRobot {
        /// Name of the root element.
        root: String,
    },
    /// The text must be processed by xacro first.
    #[error(
        "{part} has {found}, which only xacro understands; give the output of `xacro FILE.xacro`"
    )]
    Xacro {
        /// Where it is.
        part: Part,
        /// The element or text.
        found: String,
    },
    /// An element or attribute is missing.
    #[error("{part} has no {missing}")]
    Missing {
        /// The part without it.
        part: Part,
        /// The element or attribute.
        missing: String,
    },
    /// An element or attribute occurs twice.
    #[error("{part} has two {found}, allowed: one")]
    Twice {
        /// The part that has it twice.
        part: Part,
        /// The element or attribute.
        found: String,
    },
    /// Two links or two joints have the same name.
    #[error("{part} is there twice; every name must be its own")]
    SameName {
        /// The part.
        part: Part,
    },
    /// A value is not allowed.
    #[error("{part}: {field} is {value}, allowed: {allowed}")]
    Value {
        /// The part with the value.
        part: Part,
        /// Element and attribute.
        field: String,
        /// The value as written.
        value: String,
        /// The values that are allowed.
        allowed: String,
    },
    /// A joint or an option names a link or joint that is not there.
    #[error(
        "{user} names {named}, which is not there{} The {} are {}",
        suggestion(.nearest.as_deref()),
        if matches!(named, Part::Joint(_)) { "joints" } else { "links" },
        listed(.allowed.iter().map(String::as_str))
    )]
    Unknown {
        /// The joint's element or the option.
        user: String,
        /// The link or joint.
        named: Part,
        /// The name that was probably meant.
        nearest: Option<String>,
        /// The links or joints that are there.
        allowed: Vec<String>,
    },
    /// A link is the child of two joints.
    #[error(
        "link `{}` is the child of the joints `{}` and `{}`, allowed: one; a closed chain cannot be described",
        shown(.link), shown(&.joints[0]), shown(&.joints[1])
    )]
    TwoParents {
        /// The link.
        link: String,
        /// Two of its joints.
        joints: [String; 2],
    },
    /// Links follow each other in a circle.
    #[error("link `{}` follows itself: its joints form a loop", shown(.link))]
    Loop {
        /// A link of the loop.
        link: String,
    },
    /// Several links are the child of no joint.
    #[error(
        "the links {} are the child of no joint, allowed: one root; `--base LINK` chooses one",
        listed(.links.iter().map(String::as_str))
    )]
    Roots {
        /// The links.
        links: Vec<String>,
    },
    /// Several chains are equally long.
    #[error(
        "several chains have {joints} moving joints, to the links {}; `--tip LINK` chooses one",
        listed(.tips.iter().map(String::as_str))
    )]
    Chains {
        /// Moving joints of each.
        joints: usize,
        /// The last link of each.
        tips: Vec<String>,
    },
    /// The tip does not follow the base.
    #[error(
        "link `{}` does not follow link `{}`; a chain leads from the base away to the tip",
        shown(.tip), shown(.base)
    )]
    NotAChain {
        /// The link at the base.
        base: String,
        /// The link at the tip.
        tip: String,
    },
    /// The chain has no moving joint.
    #[error(
        "no joint moves between link `{}` and link `{}`, allowed: 1 to {MAX_JOINTS} revolute or \
         continuous joints; `--base LINK` and `--tip LINK` choose another chain",
        shown(.base), shown(.tip)
    )]
    NothingMoves {
        /// The link at the base.
        base: String,
        /// The link at the tip.
        tip: String,
    },
    /// The chain has too many moving joints.
    #[error(
        "{} joints move between base and tip, allowed: 1 to {MAX_JOINTS}: {}; `--lock JOINT=VALUE` \
         freezes one, `--base LINK` and `--tip LINK` shorten the chain",
        .joints.len(), listed(.joints.iter().map(String::as_str))
    )]
    TooManyJoints {
        /// From the base to the tip.
        joints: Vec<String>,
    },
    /// A joint of the chain is of a type that no arm has.
    #[error(
        "joint `{}` between base and tip is {kind}, allowed: revolute, continuous, fixed; \
         `--lock {}=VALUE` freezes it, `--base LINK` and `--tip LINK` choose a chain without it",
        shown(.joint), shown(.joint)
    )]
    Unsupported {
        /// The joint.
        joint: String,
        /// Its type.
        kind: &'static str,
    },
    /// A link that moves has an inertia that no body can have.
    #[error(
        "link `{}` has mass {mass_kg} kg and inertia {inertia_kg_m2:?} kg·m², allowed: [xx, xy, xz, yy, yz, zz] of a \
         body: a positive mass, no principal moment above the sum of the other two; \
         `--nearest-physical` takes the nearest that a body can have",
        shown(.link)
    )]
    Impossible {
        /// The link.
        link: String,
        /// kg.
        mass_kg: f64,
        /// xx, xy, xz, yy, yz, zz about the centre, kg·m².
        inertia_kg_m2: [f64; 6],
    },
    /// The links that a joint moves have no mass together.
    #[error(
        "joint `{}` moves no mass: none of its links ({}) has an <inertial>; \
         `--nearest-physical` gives them a gram",
        shown(.joint), listed(.links.iter().map(String::as_str))
    )]
    NoMass {
        /// The joint.
        joint: String,
        /// The links that move with it.
        links: Vec<String>,
    },
    /// The links that a joint moves are together a point, a rod or a sheet without thickness.
    #[error(
        "the links that joint `{}` moves ({}) have inertia {inertia_kg_m2:?} kg·m² together, that of a point, rod or \
         sheet without thickness, allowed: that of a body; `--nearest-physical` gives it a \
         thickness of a millimetre",
        shown(.joint), listed(.links.iter().map(String::as_str))
    )]
    Flat {
        /// The joint.
        joint: String,
        /// The links that move with it.
        links: Vec<String>,
        /// xx, xy, xz, yy, yz, zz about the centre, kg·m².
        inertia_kg_m2: [f64; 6],
    },
    /// The arm is outside of what a description can say.
    #[error("the URDF's arm is not allowed: {0}")]
    Description(#[source] SpecError),
    /// A description to be written into a URDF has other joints than the URDF's arm.
    #[error(
        "the description has {reason}; allowed: the arm's joints with other bodies, damping, friction and rotor inertias"
    )]
    OtherArm {
        /// The difference.
        reason: String,
    },
    /// The URDF to be written to is not the one that the arm was read from.
    #[error(
        "joint `{}` moves link `{}` in the arm, but link `{}` in the URDF; give the URDF that the arm was read from",
        shown(.joint), shown(.link), shown(.found)
    )]
    OtherChild {
        /// The joint.
        joint: String,
        /// Its child in the arm.
        link: String,
        /// Its child in the URDF.
        found: String,
    },
}

fn suggestion(nearest: Option<&str>) -> String {
    nearest.map_or_else(|| ".".to_owned(), |name| format!("; did you mean `{name}`?"))
}
