//! The quota on files that are sent.

use crate::app::App;
use crate::error::ApiError;

/// The bytes that may still be sent, as it was when a file began to come.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    used: u64,
    quota: Option<u64>,
}

impl App {
    /// # Errors
    /// When there is none.
    pub(super) async fn room(&self) -> Result<Room, ApiError> {
        let Some(quota) = self.upload_quota_bytes else { return Ok(Room { used: 0, quota: None }) };
        let room = Room { used: self.store.sent_bytes().await?, quota: Some(quota) };
        room.hold(1)?;
        Ok(room)
    }
}

impl Room {
    /// # Errors
    /// When it has no room for so many bytes.
    pub fn hold(self, bytes: u64) -> Result<(), ApiError> {
        match self.quota {
            Some(quota) if self.used.saturating_add(bytes) > quota => {
                Err(ApiError::UploadQuota { quota, used: self.used })
            }
            _ => Ok(()),
        }
    }
}
