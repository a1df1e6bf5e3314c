//! The quota of sent files.

use crate::app::App;
use crate::error::ApiError;

/// The number of bytes that could still be sent when a file began to arrive.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    used: u64,
    quota: Option<u64>,
}

impl App {
    /// # Errors
    /// When there is no room.
    pub(super) async fn room(&self) -> Result<Room, ApiError> {
        let Some(quota) = self.options.upload_quota_bytes else {
            return Ok(Room { used: 0, quota: None });
        };
        let room = Room { used: self.store.sent_bytes().await?, quota: Some(quota) };
        room.hold(1)?;
        Ok(room)
    }
}

impl Room {
    /// # Errors
    /// When there is no room for this many bytes.
    pub fn hold(self, bytes: u64) -> Result<(), ApiError> {
        match self.quota {
            Some(quota) if self.used.saturating_add(bytes) > quota => {
                Err(ApiError::UploadQuota { quota, used: self.used })
            }
            _ => Ok(()),
        }
    }
}
