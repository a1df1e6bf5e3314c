//! The name that was probably meant.

use strsim::damerau_levenshtein;

/// Bytes of the longest name that is compared. Nobody means another name by a longer one, and a
/// comparison takes time in proportion to both lengths.
const LONGEST: usize = 100;

/// The one of `names` that was probably meant by `name`.
pub fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    if name.len() > LONGEST {
        return None;
    }
    let most = (name.chars().count() / 3).max(1);
    let distance = |known: &str| {
        let is_begun = name.len() >= 3 && known.starts_with(name);
        if is_begun { 0 } else { damerau_levenshtein(name, known) }
    };
    let letters = name.chars().count();
    let near = names
        .filter(|known| known.len() <= LONGEST)
        .map(|known| (distance(known), known))
        // Every name is as near to a single letter as any other.
        .filter(|(far, _)| *far <= most && *far < letters);
    near.min_by_key(|(far, _)| *far).map(|(_, known)| known)
}

/// The allowed names, and the one that was probably meant.
pub(crate) fn listed(names: &[String], meant: Option<&str>) -> String {
    let names = names.join(", ");
    match meant {
        Some(meant) => format!("{names}; did you mean `{meant}`?"),
        None => names,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_keys_is_recognized_and_another_word_is_not() {
        let names = || ["trajectories", "samples", "seed"].into_iter();
        assert_eq!(nearest("trajectorys", names()), Some("trajectories"));
        assert_eq!(nearest("traj", names()), Some("trajectories"));
        assert_eq!(nearest("sede", names()), Some("seed"));
        assert_eq!(nearest("robot", names()), None);
        assert_eq!(nearest("q", ["u", "y"].into_iter()), None);
    }

    #[test]
    fn a_name_that_is_too_long_to_be_a_slip_is_not_compared() {
        let long = "a".repeat(1 << 20);
        assert_eq!(nearest(&long, [long.as_str()].into_iter()), None);
        assert_eq!(nearest("aaa", [long.as_str()].into_iter()), None);
        let longest = "a".repeat(LONGEST);
        assert_eq!(nearest(&longest, [longest.as_str()].into_iter()), Some(longest.as_str()));
    }
}
