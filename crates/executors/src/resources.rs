//! A worker's offer as text, as engines store it: Slurm as a comment, Kubernetes as an annotation.

use spec::Resources;

/// Writes an offer, e.g. `cpus=4;gpus=0;memory_mb=8000;tags=fast+large`.
pub fn written(offer: &Resources) -> String {
    let Resources { cpus, gpus, tags, .. } = offer;
    let tags: Vec<&str> = tags.iter().map(String::as_str).collect();
    format!(
        "cpus={};gpus={gpus};memory_mb={};tags={}",
        cpus.unwrap_or(0),
        offer.megabytes(),
        tags.join("+")
    )
}

/// Reads text from [`written`]; `None` for any other text.
pub fn read(text: &str) -> Option<Resources> {
    let field = |key: &str| {
        let mut fields = text.split(';').filter_map(|field| field.split_once('='));
        fields.find(|(name, _)| *name == key).map(|(_, value)| value)
    };
    let cpus = field("cpus")?.parse().ok()?;
    let tags = field("tags")?.split('+').filter(|tag| !tag.is_empty());
    Some(Resources {
        cpus: (cpus > 0).then_some(cpus),
        gpus: field("gpus")?.parse().ok()?,
        memory_gb: Resources::gigabytes(field("memory_mb")?.parse().ok()?),
        tags: tags.map(str::to_owned).collect(),
    })
}

/// A rank of resources, higher for those that are harder to get.
pub fn rarity(resources: &Resources) -> (u32, usize, u32, u32) {
    let Resources { cpus, gpus, tags, .. } = resources;
    (*gpus, tags.len(), resources.megabytes(), cpus.unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offer_is_read_as_it_was_written() {
        let tags = ["fast".to_owned(), "large".to_owned()].into();
        let large = Resources { cpus: Some(4), gpus: 1, memory_gb: Some(16.1), tags };
        assert_eq!(written(&large), "cpus=4;gpus=1;memory_mb=16100;tags=fast+large");
        for offer in [large, Resources::default()] {
            assert_eq!(read(&written(&offer)), Some(offer));
        }
        for refused in ["", "(null)", "cpus=4", "cpus=x;gpus=0;memory_mb=0;tags="] {
            assert_eq!(read(refused), None, "{refused}");
        }
    }
}
