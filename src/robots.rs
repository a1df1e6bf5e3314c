//! The robot that a command is about: a URDF, a description, or a built-in robot.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde_json::Value;
use spec::{BaseDescription, RobotDescription, RobotModel, SpecError};

use crate::commands::submit::read_json;

/// Flags for a robot.
#[derive(Debug, Args)]
pub struct RobotArguments {
    /// A URDF, a description as JSON, or the name of a built-in robot; `-` reads standard input
    #[arg(value_name = "ARM")]
    arm: PathBuf,

    /// The URDF's link that stands [default: its root]
    #[arg(long, value_name = "LINK")]
    base: Option<String>,

    /// The URDF's link with the hand's frame [default: the end of the chain with the most moving joints]
    #[arg(long, value_name = "LINK")]
    tip: Option<String>,

    /// A joint of the URDF that shall not move, and its position in rad or m; may be given several times
    #[arg(long = "lock", value_name = "JOINT=VALUE", value_parser = lock)]
    locks: Vec<(String, f64)>,

    /// The pose of the URDF's base in the world: m, and roll, pitch and yaw in degrees [default: upright at the origin]
    #[arg(long, value_name = "X,Y,Z,ROLL,PITCH,YAW", allow_hyphen_values = true, value_parser = mount)]
    mount: Option<BaseDescription>,

    /// Take the nearest inertia that a body can have where the URDF's is impossible
    #[arg(long)]
    nearest_physical: bool,
}

/// A robot that was read.
#[derive(Debug)]
pub struct Robot {
    /// The robot as the field `robot.model` of a spec.
    pub model: RobotModel,
    /// The URDF, if the robot came from one.
    pub urdf: Option<Urdf>,
    /// Warnings about the robot, as sentences.
    pub doubts: Vec<String>,
}

/// A URDF that was read.
#[derive(Debug)]
pub struct Urdf {
    /// The text of the file.
    pub text: String,
    /// The arm in it, with the joints and lengths of the [`Robot`].
    pub arm: urdf::Arm,
}

impl Robot {
    pub fn description(&self) -> &RobotDescription {
        self.model.description()
    }

    /// The arm of the URDF, if the robot came from one.
    pub fn arm(&self) -> Option<&urdf::Arm> {
        self.urdf.as_ref().map(|urdf| &urdf.arm)
    }
}

impl RobotArguments {
    /// Reads the robot. A file comes before a built-in robot of its name.
    ///
    /// # Errors
    /// There is no such file or robot, the file is unreadable, too large, not UTF-8 or of another kind,
    /// the robot in it is not allowed, or an option is given that only a URDF has.
    pub fn read(&self) -> anyhow::Result<Robot> {
        let Some(text) = self.text()? else {
            let model = self.built_in()?;
            self.no_urdf("a built-in robot", "give its description as a file")?;
            return Ok(Robot { model, urdf: None, doubts: Vec::new() });
        };
        let place = || self.place();
        match text.trim_start_matches('\u{feff}').trim_start().chars().next() {
            Some('<') => {
                let arm = urdf::read(&text, &self.options()?).with_context(place)?;
                let model = RobotModel::Described(Box::new(arm.description.clone()));
                let doubts = arm.doubts.iter().map(ToString::to_string).collect();
                Ok(Robot { model, urdf: Some(Urdf { text, arm }), doubts })
            }
            Some('{') => {
                self.no_urdf(
                    "a description as JSON",
                    "give the arm's URDF or edit the description",
                )?;
                let description = described(&text).with_context(place)?;
                let model = RobotModel::Described(Box::new(description));
                Ok(Robot { model, urdf: None, doubts: Vec::new() })
            }
            Some(other) => bail!(
                "{} begins with {other:?}, allowed: a URDF, which begins with <, or a description as JSON, which \
                 begins with {{",
                place()
            ),
            None => bail!("{} is empty, allowed: a URDF, or a description as JSON", place()),
        }
    }

    /// The options as parameters of a request.
    pub fn parameters(&self) -> Vec<(&'static str, String)> {
        let mut parameters = Vec::new();
        parameters.extend(self.base.clone().map(|link| ("base", link)));
        parameters.extend(self.tip.clone().map(|link| ("tip", link)));
        let locks = self.locks.iter();
        parameters.extend(locks.map(|(joint, position)| ("lock", format!("{joint}={position}"))));
        if let Some(BaseDescription { position_m, rpy_deg }) = self.mount {
            let numbers = [position_m, rpy_deg].concat();
            let texts: Vec<String> = numbers.iter().map(f64::to_string).collect();
            parameters.push(("mount", texts.join(",")));
        }
        if self.nearest_physical {
            parameters.push(("nearest_physical", "true".to_owned()));
        }
        parameters
    }

    /// The robot's name on a server, if it is neither in a file nor built in. A folder may have the name
    /// or the id of a robot.
    pub fn name_on_server(&self) -> Option<Cow<'_, str>> {
        let is_file = self.arm.exists() && !self.arm.is_dir();
        let is_here = self.is_standard_input() || is_file || self.built_in().is_ok();
        (!is_here).then(|| self.arm.to_string_lossy())
    }

    /// Whether the robot is on standard input.
    pub fn is_standard_input(&self) -> bool {
        self.arm.as_os_str() == "-"
    }

    /// The text of the file, if there is one.
    fn text(&self) -> anyhow::Result<Option<String>> {
        if !self.is_standard_input() {
            if !self.arm.exists() {
                return Ok(None);
            }
            ensure!(!self.arm.is_dir(), "{} is a folder, allowed: a file", self.place());
        }
        let bytes = read_json(&self.arm, urdf::MAX_BYTES as u64)?;
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Some(text)),
            Err(error) => bail!(
                "{} is not UTF-8 from byte {} on; save it as UTF-8",
                self.place(),
                error.utf8_error().valid_up_to()
            ),
        }
    }

    /// The name of the file for messages.
    fn place(&self) -> String {
        match self.is_standard_input() {
            true => "standard input".to_owned(),
            false => self.arm.display().to_string(),
        }
    }

    /// The built-in robot of this name.
    pub fn built_in(&self) -> anyhow::Result<RobotModel> {
        let mut names = Vec::new();
        for model in RobotModel::built_in() {
            let RobotModel::BuiltIn(robot) = &model else { continue };
            if self.arm.as_os_str() == robot.name {
                return Ok(model);
            }
            names.push(robot.name);
        }
        bail!(
            "there is no file {}, and no built-in robot of that name; the built-in robots are {}",
            self.arm.display(),
            names.join(", ")
        )
    }

    fn options(&self) -> anyhow::Result<urdf::Options> {
        let mut locks = BTreeMap::new();
        for (joint, position) in &self.locks {
            let earlier = locks.insert(joint.clone(), *position);
            ensure!(earlier.is_none(), "--lock names the joint {joint:?} twice, allowed: once");
        }
        Ok(urdf::Options {
            base: self.base.clone(),
            tip: self.tip.clone(),
            locks,
            nearest_physical: self.nearest_physical,
            mount: self.mount.unwrap_or_default(),
        })
    }

    /// Refuses the options that only a URDF has, and says what to do `instead`.
    ///
    /// # Errors
    /// One of them is given.
    pub fn no_urdf(&self, what: &str, instead: &str) -> anyhow::Result<()> {
        let given = [
            ("--base", self.base.is_some()),
            ("--tip", self.tip.is_some()),
            ("--lock", !self.locks.is_empty()),
            ("--mount", self.mount.is_some()),
            ("--nearest-physical", self.nearest_physical),
        ];
        let given: Vec<&str> =
            given.iter().filter(|(_, is_given)| *is_given).map(|(name, _)| *name).collect();
        ensure!(
            given.is_empty(),
            "{} is {what}, and {} only for a URDF; {instead} instead",
            self.place(),
            match given.as_slice() {
                [option] => format!("{option} is"),
                options => format!("{} are", options.join(", ")),
            }
        );
        Ok(())
    }
}

/// A description as it stands in a spec, with all its violations.
pub fn described(text: &str) -> anyhow::Result<RobotDescription> {
    let text = text.trim_start_matches('\u{feff}');
    let value: Value = spec::read_json(text.as_bytes())
        .map_err(|fault| SpecError::one("", "", format!("not valid JSON: {fault}")))?;
    spec::shape_violations::<RobotDescription>(&value).into_result()?;
    let description: RobotDescription = serde_json::from_value(value)?;
    description.checked()?;
    Ok(description)
}

fn lock(text: &str) -> Result<(String, f64), String> {
    urdf::read_lock(text).map_err(|allowed| format!("allowed: {allowed}"))
}

fn mount(text: &str) -> Result<BaseDescription, String> {
    urdf::read_mount(text).map_err(|allowed| format!("allowed: {allowed}"))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        robot: RobotArguments,
    }

    const URDF: &str = r#"<robot name="lamp">
      <link name="foot"/>
      <link name="lever"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
        <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="shade"><inertial><mass value="0.2"/>
        <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="hip" type="revolute"><parent link="foot"/><child link="lever"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="10" velocity="2"/></joint>
      <joint name="slide" type="prismatic"><parent link="lever"/><child link="shade"/><origin xyz="0 0 0.4"/>
        <limit lower="0" upper="0.1" effort="10" velocity="1"/></joint>
    </robot>"#;

    fn arguments(line: &[&str]) -> Result<RobotArguments, clap::Error> {
        Command::try_parse_from([&["command"], line].concat()).map(|command| command.robot)
    }

    /// The robot of a file with this content, given with these options.
    fn read(content: impl AsRef<[u8]>, options: &[&str]) -> anyhow::Result<Robot> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("arm");
        std::fs::write(&file, content).unwrap();
        arguments(&[&[file.to_str().unwrap()], options].concat()).unwrap().read()
    }

    fn refused(content: impl AsRef<[u8]>, options: &[&str]) -> String {
        crate::exit::message(&read(content, options).unwrap_err())
    }

    #[test]
    fn a_urdf_is_read_with_its_options() {
        let mount = "0,-0.5,1,180,0,-90";
        let robot = read(URDF, &["--lock", "slide=0.05", "--mount", mount]).unwrap();
        let urdf = robot.urdf.as_ref().unwrap();
        assert_eq!((urdf.arm.base.as_str(), urdf.arm.tip.as_str()), ("foot", "shade"));
        assert_eq!(urdf.text, URDF);
        assert_eq!(robot.description(), &urdf.arm.description);
        assert_eq!(robot.description().joints.len(), 1);
        assert_eq!(robot.description().base.position_m[1..], [-0.5, 1.0]);
        let doubts: Vec<String> = urdf.arm.doubts.iter().map(ToString::to_string).collect();
        assert_eq!(robot.doubts, doubts);
        let shorter = read(URDF, &["--base", "foot", "--tip", "lever"]).unwrap();
        assert_eq!(shorter.urdf.unwrap().arm.tip, "lever");
        // Editors of some systems begin a file with a mark.
        assert!(read(format!("\u{feff}\n{URDF}"), &["--tip", "lever"]).is_ok());
    }

    #[test]
    fn a_description_and_a_built_in_robot_are_read_as_in_a_spec() {
        let panda = arguments(&["panda"]).unwrap().read().unwrap();
        assert_eq!(panda.model, RobotModel::panda());
        let text = serde_json::to_string(panda.description()).unwrap();
        let robot = read(&text, &[]).unwrap();
        assert_eq!(robot.description(), panda.description());
        assert!(robot.urdf.is_none() && robot.doubts.is_empty());
        assert!(matches!(robot.model, RobotModel::Described(_)));
    }

    #[test]
    fn only_a_urdf_has_options() {
        let refused = arguments(&["panda", "--base", "a", "--lock", "b=1"]).unwrap().read();
        let message = refused.unwrap_err().to_string();
        assert!(message.contains("--base, --lock are only for a URDF"), "{message}");
        for option in [&["--tip", "a"][..], &["--mount", "0,0,0,0,0,0"], &["--nearest-physical"]] {
            let refused = arguments(&[&["panda"], option].concat()).unwrap().read();
            let message = refused.unwrap_err().to_string();
            assert!(message.contains(&format!("{} is only for a URDF", option[0])), "{message}");
        }
        let description = serde_json::to_string(RobotModel::panda().description()).unwrap();
        let message = crate::exit::message(&read(description, &["--tip", "a"]).unwrap_err());
        assert!(
            message.ends_with(
                "arm is a description as JSON, and --tip is only for a URDF; give the arm's URDF or edit the \
                 description instead"
            ),
            "{message}"
        );
    }

    #[test]
    fn a_file_of_another_kind_is_refused_with_its_name_and_its_fault() {
        assert!(refused("", &[]).contains("arm is empty, allowed: a URDF"));
        assert!(refused("solid part", &[]).contains("arm begins with 's', allowed: a URDF"));
        assert!(refused([b'<', 0xff, 0xfe], &[]).contains("is not UTF-8 from byte 1 on"));
        let large = " ".repeat(urdf::MAX_BYTES + 1);
        assert!(refused(large, &[]).contains("is larger than 4 MiB"));
        let message = refused("<robot name='a'><link/></robot>", &[]);
        assert!(message.contains("arm: ") && message.contains("link"), "{message}");
        let message = refused("{\"name\": \"a\", \"joint\": []}", &[]);
        assert!(message.contains("arm: ") && message.contains("joints"), "{message}");
        assert!(refused("{\"name\": ", &[]).contains("not valid JSON: line 1"));
        let missing = arguments(&["no/such.urdf"]).unwrap().read().unwrap_err().to_string();
        assert!(missing.ends_with("the built-in robots are panda, ur10e"), "{missing}");
        assert_eq!(arguments(&["no/such.urdf"]).unwrap().name_on_server().unwrap(), "no/such.urdf");
        assert_eq!(arguments(&["panda"]).unwrap().name_on_server(), None);
        assert_eq!(arguments(&["/"]).unwrap().name_on_server().unwrap(), "/");
        let folder = arguments(&["/"]).unwrap().read().unwrap_err().to_string();
        assert_eq!(folder, "/ is a folder, allowed: a file");
    }

    #[test]
    fn a_violation_names_its_field_as_seen_from_the_description() {
        let mut description = RobotModel::panda().description().clone();
        description.joints[2].link.mass_kg = -1.0;
        let message = refused(serde_json::to_string(&description).unwrap(), &[]);
        assert!(message.contains("arm: joints[2].link.mass_kg is -1"), "{message}");
    }

    #[test]
    fn locks_and_mounts_are_checked_by_the_command_line() {
        for wrong in [
            ["--lock", "slide"],
            ["--lock", "slide="],
            ["--lock", "=1"],
            ["--lock", "slide=inf"],
            ["--mount", "1,2,3"],
            ["--mount", "1,2,3,4,5,nan"],
            ["--mount", "1,2,3,4,5,6,7"],
        ] {
            let error = arguments(&[&["panda"], &wrong[..]].concat()).unwrap_err().to_string();
            assert!(error.contains("allowed: "), "{error}");
        }
        let twice = ["--lock", "slide=0", "--lock", "slide=0.1"];
        assert!(refused(URDF, &twice).contains("names the joint \"slide\" twice"));
    }
}
