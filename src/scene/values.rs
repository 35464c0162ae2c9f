//! Values that have a notation of their own, the same in scene files and on the command line.

use super::{Background, Exposure, UNLIMITED};
use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// A linear RGB triple. Written as one number (grey), three numbers (linear), or "#rrggbb" (sRGB, made linear).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "RgbNotation")]
pub struct Rgb(pub [f32; 3]);

/// A factor greater than 0. On its way from one key frame to the next it gains by equal ratios.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(transparent)]
pub struct Factor(pub f64);

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number, [r, g, b] or \"#rrggbb\"")]
enum RgbNotation {
    Grey(f64),
    Linear([f64; 3]),
    Text(String),
}

impl TryFrom<RgbNotation> for Rgb {
    type Error = String;

    fn try_from(notation: RgbNotation) -> Result<Self, String> {
        match notation {
            RgbNotation::Grey(v) => Ok(Self([v as f32; 3])),
            RgbNotation::Linear(v) => Ok(Self(v.map(|c| c as f32))),
            RgbNotation::Text(text) => text.parse(),
        }
    }
}

impl FromStr for Rgb {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("'{text}' is no colour: write one number, r,g,b (linear) or #rrggbb (sRGB)");
        if let Some(hex) = text.strip_prefix('#') {
            if hex.len() != 6 || !hex.bytes().all(|b| b.is_ascii_hexdigit()) {
                return Err(bad());
            }
            let rgb = u32::from_str_radix(hex, 16).map_err(|_| bad())?;
            return Ok(Self([16, 8, 0].map(|shift| srgb_to_linear(f64::from(rgb >> shift & 0xFF) / 255.0) as f32)));
        }
        let numbers = numbers::<f32>(text, ',').ok_or_else(bad)?;
        match numbers[..] {
            [grey] => Ok(Self([grey; 3])),
            [r, g, b] => Ok(Self([r, g, b])),
            _ => Err(bad()),
        }
    }
}

impl From<Rgb> for Vec3 {
    fn from(rgb: Rgb) -> Self {
        Vec3::from(rgb.0)
    }
}

/// The numbers of a list; `None` if one of them is not a number.
pub fn numbers<T: FromStr>(text: &str, separator: char) -> Option<Vec<T>> {
    text.split(separator).map(|n| n.trim().parse().ok()).collect()
}

/// IEC 61966-2-1: the linear value of an sRGB-encoded one from 0 to 1.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// [`Background`] as it is written: "environment", "transparent", or a colour.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "RgbNotation")]
pub struct BackgroundValue(pub Background);

impl TryFrom<RgbNotation> for BackgroundValue {
    type Error = String;

    fn try_from(notation: RgbNotation) -> Result<Self, String> {
        match notation {
            RgbNotation::Text(text) => text.parse(),
            other => Ok(Self(Background::Color(Rgb::try_from(other)?.into()))),
        }
    }
}

impl FromStr for BackgroundValue {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "environment" => Ok(Self(Background::Environment)),
            "transparent" => Ok(Self(Background::Transparent)),
            color => match color.parse::<Rgb>() {
                Ok(rgb) => Ok(Self(Background::Color(rgb.into()))),
                Err(_) => Err(format!("'{text}' is no background: write environment, transparent, #rrggbb or r,g,b")),
            },
        }
    }
}

/// [`Exposure`] as it is written: "auto" or a number of stops.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "ExposureNotation")]
pub struct ExposureValue(pub Exposure);

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"auto\" or a number of stops")]
enum ExposureNotation {
    Stops(f32),
    Text(String),
}

impl TryFrom<ExposureNotation> for ExposureValue {
    type Error = String;

    fn try_from(notation: ExposureNotation) -> Result<Self, String> {
        match notation {
            ExposureNotation::Stops(stops) => Ok(Self(Exposure::Stops(stops))),
            ExposureNotation::Text(text) => text.parse(),
        }
    }
}

impl FromStr for ExposureValue {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self(Exposure::Auto));
        }
        let stops = text.parse().map_err(|_| format!("'{text}' is no exposure: write auto or a number of stops"))?;
        Ok(Self(Exposure::Stops(stops)))
    }
}

/// Scattering orders as they are written: a number, or "unlimited".
#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "OrdersNotation")]
pub struct Orders(pub u32);

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or \"unlimited\"")]
enum OrdersNotation {
    Number(u32),
    Text(String),
}

impl TryFrom<OrdersNotation> for Orders {
    type Error = String;

    fn try_from(notation: OrdersNotation) -> Result<Self, String> {
        match notation {
            OrdersNotation::Number(orders) => Ok(Self(orders)),
            OrdersNotation::Text(text) => text.parse(),
        }
    }
}

impl FromStr for Orders {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            UNLIMITED_NAME => Ok(Self(UNLIMITED)),
            number => number.parse().map(Self).map_err(|_| {
                format!("'{text}' is no number of orders: write a number of at least 1, or {UNLIMITED_NAME}")
            }),
        }
    }
}

const UNLIMITED_NAME: &str = "unlimited";

/// As it is written.
impl fmt::Debug for Orders {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == UNLIMITED { f.write_str(UNLIMITED_NAME) } else { write!(f, "{}", self.0) }
    }
}

/// Writes orders as they are read.
pub(super) fn write_orders<S: Serializer>(orders: &u32, serializer: S) -> Result<S::Ok, S::Error> {
    match *orders {
        UNLIMITED => serializer.serialize_str(UNLIMITED_NAME),
        number => serializer.serialize_u32(number),
    }
}

/// What the proxy's hash keeps of a colour. Written as a number of leading bits 0..8 or eight binary digits, one for all
/// channels or one for each of R, G, B, A; or as "adaptive", "adaptive:TOLERANCE".
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "MaskNotation")]
pub enum Mask {
    /// Bits of each channel. [255; 4] is lossless.
    Channels([u8; 4]),
    /// As few levels as keep the light's root mean square error to this share of its mean, 0 to 1; 0 is lossless.
    Adaptive(f32),
}

/// Tolerance of a mask that is just "adaptive".
pub const ADAPTIVE_TOLERANCE: f32 = 0.5;

impl Mask {
    /// As the kernels use it: R in the lowest byte, or the bits of the tolerance.
    pub fn word(self) -> u32 {
        match self {
            Mask::Channels(bits) => u32::from_le_bytes(bits),
            Mask::Adaptive(tolerance) => tolerance.to_bits(),
        }
    }

    /// Whether the histogram of the colours chooses the levels.
    pub fn is_adaptive(self) -> bool {
        matches!(self, Mask::Adaptive(_))
    }

    /// The mask of the same kind that a kernel's word stands for.
    pub fn with_word(self, word: u32) -> Self {
        match self {
            Mask::Channels(_) => Mask::Channels(word.to_le_bytes()),
            Mask::Adaptive(_) => Mask::Adaptive(f32::from_bits(word)),
        }
    }
}

/// As it is written on the command line.
impl fmt::Display for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Mask::Channels([r, g, b, a]) if [g, b, a] == [r; 3] => write!(f, "{r:08b}"),
            Mask::Channels([r, g, b, a]) => write!(f, "{r:08b},{g:08b},{b:08b},{a:08b}"),
            Mask::Adaptive(tolerance) => write!(f, "adaptive:{tolerance}"),
        }
    }
}

/// Bits as four numbers, a tolerance as it is written.
impl Serialize for Mask {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Mask::Channels(bits) => bits.serialize(serializer),
            Mask::Adaptive(_) => serializer.collect_str(self),
        }
    }
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number of bits, \"11110000\", or four of them, or \"adaptive\"")]
enum MaskNotation {
    Bits(u32),
    Text(String),
    Channels([ChannelNotation; 4]),
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number of bits or \"11110000\"")]
enum ChannelNotation {
    Bits(u32),
    Text(String),
}

impl TryFrom<MaskNotation> for Mask {
    type Error = String;

    fn try_from(notation: MaskNotation) -> Result<Self, String> {
        match notation {
            MaskNotation::Bits(bits) => bits.to_string().parse(),
            MaskNotation::Text(text) => text.parse(),
            MaskNotation::Channels(channels) => {
                let texts = channels.map(|c| match c {
                    ChannelNotation::Bits(bits) => bits.to_string(),
                    ChannelNotation::Text(text) => text,
                });
                texts.join(",").parse()
            }
        }
    }
}

impl FromStr for Mask {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || {
            format!(
                "'{text}' is no mask: write 0 to 8 (leading bits) or eight binary digits, once or 4 times, or \
                 adaptive:TOLERANCE with a tolerance of 0 to 1"
            )
        };
        if let Some(rest) = text.strip_prefix("adaptive") {
            let tolerance = match rest.strip_prefix(':') {
                Some(number) => number.parse().map_err(|_| bad())?,
                None if rest.is_empty() => ADAPTIVE_TOLERANCE,
                None => return Err(bad()),
            };
            // -0 as 0: the kernels compare bits.
            return if (0.0..=1.0).contains(&tolerance) { Ok(Self::Adaptive(tolerance.abs())) } else { Err(bad()) };
        }
        let channel = |text: &str| {
            if text.len() == 8 {
                return u8::from_str_radix(text, 2).ok().filter(|_| !text.starts_with('+'));
            }
            let bits: u32 = text.parse().ok().filter(|&b| b <= 8)?;
            Some((0xFF00u32 >> bits) as u8)
        };
        let channels: Option<Vec<u8>> = text.split(',').map(|c| channel(c.trim())).collect();
        match channels.ok_or_else(bad)?[..] {
            [one] => Ok(Self::Channels([one; 4])),
            [r, g, b, a] => Ok(Self::Channels([r, g, b, a])),
            _ => Err(bad()),
        }
    }
}

/// An axis of the file's physical space that is to point upwards in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Deserialize)]
pub enum UpAxis {
    /// +x
    #[serde(rename = "x")]
    #[value(name = "x")]
    X,
    /// −x
    #[serde(rename = "-x")]
    #[value(name = "-x")]
    MinusX,
    /// +y
    #[serde(rename = "y")]
    #[value(name = "y")]
    Y,
    /// −y
    #[serde(rename = "-y")]
    #[value(name = "-y")]
    MinusY,
    /// +z
    #[serde(rename = "z")]
    #[value(name = "z")]
    Z,
    /// −z
    #[serde(rename = "-z")]
    #[value(name = "-z")]
    MinusZ,
}

impl UpAxis {
    /// The rotation that takes this axis to the world's +z. It never mirrors.
    pub fn to_z(self) -> DMat3 {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let columns = match self {
            UpAxis::X => [z, y, -x],
            UpAxis::MinusX => [-z, y, x],
            UpAxis::Y => [x, z, -y],
            UpAxis::MinusY => [x, -z, y],
            UpAxis::Z => [x, y, z],
            UpAxis::MinusZ => [x, -y, -z],
        };
        DMat3::from_cols(columns[0], columns[1], columns[2])
    }
}
