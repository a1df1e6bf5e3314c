//! A table of a dataset's channels.

use wire::ChannelSummary;

use crate::page::text;

pub struct ChannelRow {
    pub name: String,
    pub about: String,
    pub unit: String,
    pub min: String,
    pub max: String,
    pub mean: String,
    pub std: String,
}

impl From<&ChannelSummary> for ChannelRow {
    fn from(channel: &ChannelSummary) -> Self {
        Self {
            name: channel.name.clone(),
            about: channel.about.clone().unwrap_or_default(),
            unit: channel.unit.clone().unwrap_or_default(),
            min: text::signed(channel.min),
            max: text::signed(channel.max),
            mean: text::signed(channel.mean),
            std: text::value(channel.std),
        }
    }
}
