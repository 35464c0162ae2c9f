//! File names by scene and number.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A path in which `{}` or `{:04}` stands for a frame's number, `{scene}` for its scene's name; each at most once.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern(Vec<Part>);

#[derive(Clone, Debug, PartialEq)]
enum Part {
    Text(String),
    /// At least so many digits.
    Number(usize),
    Scene,
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = |what: &str| {
            let forms = "write {} or {:04} for the frame's number, {scene} for the scene's name, each once at most";
            format!("'{text}' {what}: {forms}")
        };
        let mut parts = Vec::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            let (name, after) = after.split_once('}').ok_or_else(|| bad("has no } for its {"))?;
            let unknown = || bad(&format!("has {{{name}}}"));
            let part = match (name, name.strip_prefix(":0")) {
                ("", _) => Part::Number(1),
                ("scene", _) => Part::Scene,
                (_, Some(digits)) => {
                    Part::Number(digits.parse().ok().filter(|d| (1..=9).contains(d)).ok_or_else(unknown)?)
                }
                _ => return Err(unknown()),
            };
            parts.extend([Part::Text(before.into()), part]);
            rest = after;
        }
        parts.push(Part::Text(rest.into()));
        let pattern = Self(parts);
        let is_stray = |part: &Part| matches!(part, Part::Text(text) if text.contains('}'));
        if pattern.0.iter().any(is_stray) {
            return Err(bad("has a } without a {"));
        }
        let count = |is: fn(&Part) -> bool| pattern.0.iter().filter(|part| is(part)).count();
        if count(|p| matches!(p, Part::Number(_))) > 1 || count(|p| *p == Part::Scene) > 1 {
            return Err(bad("says twice where something goes"));
        }
        Ok(pattern)
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|part| match part {
            Part::Text(text) => f.write_str(text),
            Part::Number(1) => f.write_str("{}"),
            Part::Number(digits) => write!(f, "{{:0{digits}}}"),
            Part::Scene => f.write_str("{scene}"),
        })
    }
}

impl Pattern {
    /// Does it say where the number goes?
    pub fn has_number(&self) -> bool {
        self.0.iter().any(|part| matches!(part, Part::Number(_)))
    }

    /// Does it say where the scene's name goes?
    pub fn has_scene(&self) -> bool {
        self.0.contains(&Part::Scene)
    }

    /// The path of a frame.
    pub fn path(&self, scene: &str, frame: u32) -> PathBuf {
        let text = |part: &Part| match part {
            Part::Text(text) => text.clone(),
            Part::Number(digits) => format!("{frame:0digits$}"),
            Part::Scene => scene.to_owned(),
        };
        self.0.iter().map(text).collect::<String>().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_their_parts_where_the_pattern_says() {
        let name =
            |pattern: &str, frame| pattern.parse::<Pattern>().unwrap().path("skull", frame).display().to_string();
        assert_eq!(name("out/f_{:04}.png", 7), "out/f_0007.png");
        assert_eq!(name("{}.exr", 12), "12.exr");
        assert_eq!(name("{:02}", 123), "123");
        assert_eq!(name("{scene}/{:02}.png", 3), "skull/03.png");
        assert_eq!(name("{}_{scene}", 3), "3_skull");
        assert_eq!(name("one.png", 3), "one.png");
        for text in ["{scene}/{:02}.png", "{}", "one.png"] {
            assert_eq!(text.parse::<Pattern>().unwrap().to_string(), text);
        }
        for bad in
            ["{}{}.png", "{:4}.png", "{:00}.png", "{x}.png", "a}{.png", "{:0.png", "}{}", "{:0-1}", "{scene}{scene}"]
        {
            assert!(bad.parse::<Pattern>().unwrap_err().contains("{scene}"), "{bad}");
        }
    }
}
