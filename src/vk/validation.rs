//! The Khronos validation layer: which settings it gets, and the sink that collects its messages.

use crate::{Error, Result};
use ash::vk;
use std::ffi::{CStr, c_void};
use std::sync::Mutex;

/// Name of the Khronos layer.
pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Which checks run beside the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Validation {
    /// None; what a user's render does.
    #[default]
    Off,
    /// Core and synchronization validation.
    #[value(name = "core")]
    #[serde(rename = "core")]
    CoreAndSync,
    /// Core validation and what the layer thinks of as good practice.
    BestPractices,
    /// GPU-assisted validation alone (slower, needs a descriptor set slot of its own).
    GpuAssisted,
}

/// Severity of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[allow(missing_docs, reason = "the variants say it")]
pub enum Severity {
    Warning,
    Error,
}

/// One message of the validation layer or of Tyndall's own checks.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Message {
    /// How bad.
    pub severity: Severity,
    /// The layer's message id (`VUID-...`, `SYNC-HAZARD-...`), or `TYNDALL-...` for our own checks.
    pub id: String,
    /// Text with object names.
    pub text: String,
}

/// Nothing may have been reported.
///
/// Errors: something was; the error counts the messages and quotes the first.
pub fn no_messages(messages: &[Message]) -> crate::Result<()> {
    match messages.first() {
        Some(first) => Err(crate::Error::Validation { count: messages.len(), first: first.to_string() }),
        None => Ok(()),
    }
}

impl std::fmt::Display for Message {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "[{:?}] {}: {}", self.severity, self.id, self.text)
    }
}

/// Collects messages; one per context.
#[derive(Default)]
pub(super) struct Sink {
    messages: Mutex<Vec<Message>>,
}

impl Sink {
    pub(super) fn push(&self, message: Message) {
        self.messages.lock().unwrap_or_else(|e| e.into_inner()).push(message);
    }

    pub(super) fn messages(&self) -> Vec<Message> {
        self.messages.lock().unwrap_or_else(|e| e.into_inner()).clone()
    }
}

/// Messages that are let through: id and a part of the text, each with the layer versions that send it and the reason.
const ALLOWED: &[(&str, &str)] = &[
    // Layers of the `LayerSettings::Settings` kind (seen: 1.4.309): GPU-assisted validation tells which device features
    // and limits it changes for itself. Nothing of the program's own use is judged. What it cannot do and leaves out
    // has the same id and other words, and is not let through.
    ("WARNING-GPU-Assisted-Validation", "Internal Warning: Forcing "),
    ("WARNING-GPU-Assisted-Validation", "Internal Warning: Setting "),
    // Best practices (seen: 1.3.239; newer layers have the second id) advise against the debugging extensions that are on
    // because validation is.
    (
        "UNASSIGNED-BestPractices-vkCreateInstance-specialuse-extension-debugging",
        "intended to support use by applications when debugging",
    ),
    ("BestPractices-specialuse-extension", "intended to support use by applications when debugging"),
];

fn is_allowed(id: &str, text: &str) -> bool {
    ALLOWED.iter().any(|(allowed, part)| *allowed == id && text.contains(part))
}

/// Called by the layer. Never unwinds, always lets the call go on.
unsafe extern "system" fn callback(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    if data.is_null() || user.is_null() || std::thread::panicking() {
        return vk::FALSE;
    }
    // SAFETY: `user` is the sink that outlives the instance (see `Context`), `data` is valid during the call, and its
    // strings are null or zero-terminated.
    let (sink, id, text) = unsafe {
        let data = &*data;
        let string = |p: *const std::ffi::c_char| {
            if p.is_null() { String::new() } else { CStr::from_ptr(p).to_string_lossy().into_owned() }
        };
        (&*user.cast::<Sink>(), string(data.p_message_id_name), string(data.p_message))
    };
    if is_allowed(&id, &text) {
        return vk::FALSE;
    }
    let severity = if severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR) {
        Severity::Error
    } else {
        Severity::Warning
    };
    sink.push(Message { severity, id, text });
    vk::FALSE
}

/// The messenger's create info; chained to the instance too, so that its creation and destruction are covered.
pub(super) fn messenger_info(sink: &Sink) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::GENERAL)
        .pfn_user_callback(Some(callback))
        .user_data(std::ptr::from_ref(sink).cast_mut().cast())
}

/// How this layer version wants its settings.
pub(super) enum LayerSettings {
    /// `VK_EXT_layer_settings`, layers since 2023-12.
    Settings,
    /// `VK_EXT_validation_features`, older ones.
    Features,
}

/// The layer's version, as of the Vulkan that it knows.
pub(super) fn layer_version(entry: &ash::Entry) -> Option<String> {
    // SAFETY: a plain enumeration call on a loaded entry.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.ok()?;
    let version = layers.iter().find(|l| l.layer_name_as_c_str() == Ok(LAYER))?.spec_version;
    let [major, minor, patch] =
        [vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version)];
    Some(format!("{major}.{minor}.{patch}"))
}

/// Finds the layer and how to talk to it.
pub(super) fn find_layer(entry: &ash::Entry) -> Result<LayerSettings> {
    // SAFETY: plain enumeration calls on a loaded entry.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    let found = layers.iter().any(|l| l.layer_name_as_c_str() == Ok(LAYER));
    if !found {
        return Err(Error::NoDevice {
            problem: "validation was asked for, but the Vulkan layer VK_LAYER_KHRONOS_validation is not installed"
                .into(),
            cure: "install it (Debian, Ubuntu: vulkan-validationlayers) or run without --validate".into(),
        });
    }
    // SAFETY: as above.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(Some(LAYER)) }.unwrap_or_default();
    let has_settings = extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::layer_settings::NAME));
    Ok(if has_settings { LayerSettings::Settings } else { LayerSettings::Features })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_listed_words_of_a_listed_id_pass() {
        let id = "WARNING-GPU-Assisted-Validation";
        assert!(is_allowed(id, "vkCreateDevice(): Internal Warning: Forcing shaderInt64 to VK_TRUE"));
        assert!(!is_allowed(
            id,
            "vkCreateDevice(): Internal Warning: Ray Query validation option was enabled, but ..."
        ));
        assert!(!is_allowed("UNASSIGNED-GPU-Assisted-Validation", "Internal Error, GPU-AV is being disabled"));
    }
}
