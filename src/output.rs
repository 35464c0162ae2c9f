//! Pictures and the files they go to: PNG (8 or 16 bit, tone-mapped) and EXR (32-bit float, linear).
//!
//! A file appears under its name only when it is complete: it is encoded in memory, written under a temporary name
//! in the same directory, and renamed.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{BufReader, Cursor, Write};
use std::path::{Path, PathBuf};

use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ColorType, DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, ImageReader};

use crate::scene::values::srgb_to_linear;
use crate::scene::{Exposure, ToneCurve};
use crate::{Error, Result};

/// A picture of linear radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGB (Rec. 709) premultiplied by alpha, and alpha from 0 to 1; row by row, row 0 on top.
    pub pixels: Vec<[f32; 4]>,
}

/// Bits per channel of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum BitDepth {
    /// 8 bits, dithered against banding.
    #[default]
    #[value(name = "8")]
    Eight,
    /// 16 bits.
    #[value(name = "16")]
    Sixteen,
}

/// How linear radiance becomes the display values of a PNG.
#[derive(Clone, Copy, Debug)]
pub struct PngOptions {
    /// Bits per channel.
    pub bits: BitDepth,
    /// What pixels are multiplied by first.
    pub exposure: Exposure,
    /// What compresses them to 0..1 next. The sRGB transfer function comes last.
    pub tone: ToneCurve,
}

/// File formats a picture can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Integer, tone-mapped, sRGB, straight (not premultiplied) alpha.
    Png,
    /// 32-bit float, linear, premultiplied alpha, neither exposed nor tone-mapped.
    Exr,
}

impl Format {
    /// The format that the extension of `path` names.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "png" => Ok(Format::Png),
            "exr" => Ok(Format::Exr),
            "" => Err(Error::file(path, "the output has no extension", "name it .png (for display) or .exr (linear)")),
            _ => Err(Error::file(
                path,
                format!("unknown picture format '.{extension}'"),
                "name it .png (for display) or .exr (linear)",
            )),
        }
    }
}

impl Picture {
    /// A picture with every pixel the same.
    pub fn filled(width: u32, height: u32, pixel: [f32; 4]) -> Self {
        Self { width, height, pixels: vec![pixel; width as usize * height as usize] }
    }

    /// An error that counts the pixels of `path`'s picture which are not finite and names the first; Ok if there
    /// is none.
    pub fn check_finite(&self, path: &Path) -> Result<()> {
        let bad = |pixel: &[f32; 4]| pixel.iter().any(|c| !c.is_finite());
        let Some(first) = self.pixels.iter().position(bad) else { return Ok(()) };
        let count = self.pixels.iter().filter(|p| bad(p)).count();
        let (x, y) = (first % self.width as usize, first / self.width as usize);
        Err(Error::file(
            path,
            format!("{count} pixel(s) are NaN or infinite, the first at column {x}, row {y}: {:?}", self.pixels[first]),
            "if tyndall computed this picture it is a bug; please report the scene, the device and the seed",
        ))
    }
}

/// Checks, before the work starts, that `path` can be written and that its extension names a picture format.
pub fn check_picture_path(path: &Path) -> Result<()> {
    Format::of(path)?;
    check_writable(path)
}

/// Checks that `path` is a folder, or a place for one.
pub fn check_folder(path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        return Err(Error::file(path, "is no folder", "name a folder, or a place for a new one"));
    }
    Ok(())
}

/// Makes sure that there is a folder at `path`.
pub fn make_folder(path: &Path) -> Result<()> {
    check_folder(path)?;
    std::fs::create_dir_all(path).map_err(|e| Error::io(path, "create", e))
}

/// Checks that a file can be created (or replaced) at `path`. Leaves nothing behind.
pub fn check_writable(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::file(path, "is a directory", "name a file"));
    }
    let directory = directory_of(path);
    if !directory.is_dir() {
        return Err(Error::file(
            path,
            format!("cannot be written: '{}' is not an existing directory", directory.display()),
            "create the directory or choose another place",
        ));
    }
    if is_special(path) {
        return Ok(());
    }
    temporary_beside(path).map(drop)
}

/// Writes a whole file: a temporary file beside it, then a rename. A link is followed. Devices and pipes, which
/// cannot be renamed over, are written directly.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    replace(path, |temporary| {
        let mut file = File::options().write(true).open(temporary).map_err(|e| Error::io(path, "open", e))?;
        file.write_all(bytes).map_err(|e| Error::io(path, "write", e))
    })
}

/// The same for a file that `write` fills: it gets the path of an empty file, with the extension of `path`.
pub fn replace(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    if is_special(path) {
        return write(path);
    }
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let temporary = temporary_beside(&target)?;
    write(temporary.path())?;
    // Without this a power cut after the rename could leave an empty file under the final name.
    temporary.as_file().sync_all().map_err(|e| Error::io(path, "write", e))?;
    temporary.persist(&target).map_err(|e| Error::io(path, "create", e.error))?;
    Ok(())
}

/// Removes what killed processes left of files that they were writing in this folder. What is still being written is locked,
/// and stays; so does everything where the file system knows no locks.
pub fn remove_leftovers(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if !entry.file_name().to_string_lossy().starts_with(TEMPORARY) {
            continue;
        }
        let is_left = File::options().write(true).open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if is_left {
            // Somebody else may be faster.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The directory that holds `path`.
pub fn directory_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// True for an existing device, pipe or socket.
fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// How the names of temporary files begin.
const TEMPORARY: &str = ".tyndall-";

/// A temporary file in the directory of `path`, with its extension: deleted when dropped, locked until then.
fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile> {
    let suffix = path.extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY).suffix(&suffix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary files are private by default; this one becomes an ordinary file, so the umask decides.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    loop {
        let file = builder.tempfile_in(directory_of(path)).map_err(|e| Error::io(path, "create", e))?;
        // Whoever took it for a leftover, before it was locked, has the lock and removes it.
        let is_taken = matches!(file.as_file().try_lock(), Err(std::fs::TryLockError::WouldBlock));
        if !is_taken && file.path().exists() {
            return Ok(file);
        }
    }
}

/// Writes a picture in the format that the extension names. `png` does not matter to EXR. Returns the exposure in
/// stops that a PNG was written with.
pub fn write_picture(path: &Path, picture: &Picture, png: &PngOptions) -> Result<Option<f32>> {
    let format = Format::of(path)?;
    picture.check_finite(path)?;
    let (bytes, stops) = match format {
        Format::Png => {
            let stops = stops_of(picture, png);
            (encode_png(picture, stops, png), Some(stops))
        }
        Format::Exr => (encode_exr(picture), None),
    };
    let bytes = bytes.map_err(|e| Error::file(path, format!("cannot be encoded: {e}"), "choose a smaller --size"))?;
    write_atomically(path, &bytes)?;
    Ok(stops)
}

/// The bytes of an 8-bit PNG.
///
/// Errors: the picture is too large for the format.
pub fn encode_8_bit_png(picture: &Picture, png: &PngOptions) -> Result<Vec<u8>> {
    let png = PngOptions { bits: BitDepth::Eight, ..*png };
    encode_png(picture, stops_of(picture, &png), &png)
        .map_err(|e| Error::input("picture", format!("cannot be encoded: {e}"), "choose a smaller --size"))
}

fn encode_png(picture: &Picture, stops: f32, png: &PngOptions) -> image::ImageResult<Vec<u8>> {
    let mut file = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive);
    let (width, height) = (picture.width, picture.height);
    match png.bits {
        BitDepth::Eight => {
            encoder.write_image(&to_8_bit(picture, stops, png.tone), width, height, ExtendedColorType::Rgba8)?;
        }
        BitDepth::Sixteen => {
            let values = to_16_bit(picture, stops, png.tone);
            encoder.write_image(bytemuck::cast_slice(&values), width, height, ExtendedColorType::Rgba16)?;
        }
    }
    Ok(file)
}

fn encode_exr(picture: &Picture) -> image::ImageResult<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    let bytes = bytemuck::cast_slice(&picture.pixels);
    OpenExrEncoder::new(&mut file).write_image(bytes, picture.width, picture.height, ExtendedColorType::Rgba32F)?;
    Ok(file.into_inner())
}

/// 8-bit RGBA of a PNG. Dithered: a pixel is rounded up with a chance equal to the fraction that rounding drops,
/// so smooth gradients show no bands. Values that 8 bits hold exactly are not changed.
fn to_8_bit(picture: &Picture, stops: f32, tone: ToneCurve) -> Vec<u8> {
    let display = Display::new(stops, tone);
    let width = picture.width as usize;
    let pixel = |(i, p): (usize, &[f32; 4])| {
        let threshold = dither_threshold((i % width) as u32, (i / width) as u32);
        // The tiny addend keeps exact values from being rounded down by the rounding errors of the curves.
        display.encode(*p).map(|v| (v * 255.0 + threshold + 1e-4).min(255.0) as u8)
    };
    picture.pixels.iter().enumerate().flat_map(pixel).collect()
}

/// 16-bit RGBA of a PNG, rounded to nearest.
fn to_16_bit(picture: &Picture, stops: f32, tone: ToneCurve) -> Vec<u16> {
    let display = Display::new(stops, tone);
    picture.pixels.iter().flat_map(|p| display.encode(*p).map(|v| (v * 65535.0).round() as u16)).collect()
}

/// Threshold in [0, 1 − 2⁻⁸) of an ordered dither without visible pattern: the additive lattice of the plastic number
/// ("R2 sequence"), whose spectrum has little energy at low frequencies. The same for all channels, so grey stays grey.
fn dither_threshold(x: u32, y: u32) -> f64 {
    /// 2³²/ρ and 2³²/ρ², ρ = 1.32471795724… the real root of ρ³ = ρ + 1.
    const STEPS: [u32; 2] = [3_242_174_889, 2_447_445_414];
    let phase = x.wrapping_mul(STEPS[0]).wrapping_add(y.wrapping_mul(STEPS[1]));
    f64::from(phase >> 24) / 256.0
}

/// The chain from linear premultiplied radiance to display values.
struct Display {
    scale: f64,
    tone: ToneCurve,
}

impl Display {
    fn new(stops: f32, tone: ToneCurve) -> Self {
        Self { scale: f64::from(stops).exp2(), tone }
    }

    /// Straight-alpha sRGB in [0,1] of a premultiplied linear pixel. Negative radiance (noise of unbiased
    /// estimators) is black. A pixel with alpha 0 has no colour in a PNG.
    fn encode(&self, pixel: [f32; 4]) -> [f64; 4] {
        let [r, g, b, a] = pixel.map(f64::from);
        let alpha = a.clamp(0.0, 1.0);
        if alpha == 0.0 {
            return [0.0; 4];
        }
        let rgb = [r, g, b].map(|c| (c / alpha * self.scale).clamp(0.0, f64::from(f32::MAX)));
        let mapped = match self.tone {
            ToneCurve::Linear => rgb,
            ToneCurve::Filmic => filmic(rgb),
        };
        let [r, g, b] = mapped.map(|c| srgb_encode(c.min(1.0)));
        [r, g, b, alpha]
    }
}

/// Luminance of linear Rec. 709 RGB (ITU-R BT.709, the Y row of the primaries' matrix).
pub fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// IEC 61966-2-1: linear [0,1] to sRGB [0,1].
fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Contrast of the filmic curve at the dark end, in the log-log sense.
const FILMIC_CONTRAST: f64 = 1.25;
/// The luminance that the filmic curve leaves unchanged: photographic mid-grey.
const FILMIC_PIVOT: f64 = 0.18;

/// The filmic curve of a luminance: y = xᶜ / (xᶜ + k), the Hill (Naka-Rushton) response of film and retina.
/// A gentle toe below mid-grey, log-log slope c(1 − y), a shoulder that reaches 1 only at infinity; smooth everywhere
/// above 0. k is such that mid-grey stays.
fn filmic_curve(x: f64) -> f64 {
    let p = x.powf(FILMIC_CONTRAST);
    if p.is_finite() { p / (p + filmic_k()) } else { 1.0 }
}

/// Inverse of [`filmic_curve`], for y in [0,1).
fn filmic_inverse(y: f64) -> f64 {
    (filmic_k() * y / (1.0 - y)).powf(1.0 / FILMIC_CONTRAST)
}

fn filmic_k() -> f64 {
    FILMIC_PIVOT.powf(FILMIC_CONTRAST) * (1.0 - FILMIC_PIVOT) / FILMIC_PIVOT
}

/// Filmic tone mapping of linear RGB ≥ 0: the curve acts on the luminance and the colour follows, so hues do not
/// shift. A colour too saturated for its new luminance is moved towards grey of that luminance, just into the gamut:
/// bright saturated light becomes whiter, as on film.
fn filmic(rgb: [f64; 3]) -> [f64; 3] {
    let y = luminance(rgb);
    if y <= 0.0 {
        return [0.0; 3];
    }
    let mapped = filmic_curve(y);
    let scaled = rgb.map(|c| c * (mapped / y));
    let top = scaled.into_iter().fold(0.0, f64::max);
    if top <= 1.0 {
        return scaled;
    }
    let keep = (1.0 - mapped) / (top - mapped);
    scaled.map(|c| mapped + keep * (c - mapped))
}

/// Share of the lit pixels that automatic exposure lets go beyond its target: highlights and fireflies.
const AUTO_EXPOSURE_TAIL: f64 = 0.01;
/// Linear display value that automatic exposure gives the brightest pixel before that tail.
const AUTO_EXPOSURE_TARGET: f64 = 0.7;

/// Stops that the options mean for this picture.
pub fn stops_of(picture: &Picture, png: &PngOptions) -> f32 {
    match png.exposure {
        Exposure::Stops(stops) => stops,
        Exposure::Auto => automatic_stops(picture, png.tone),
    }
}

/// The 99th percentile of the luminance (as over black) of the lit pixels comes out at 0.8 after the tone curve.
/// Unlit pixels do not count, so a small object on black is exposed like a large one; single fireflies lie in the tail.
/// A picture without light gets 0 stops.
fn automatic_stops(picture: &Picture, tone: ToneCurve) -> f32 {
    let lit = |p: &[f32; 4]| {
        let y = luminance([p[0], p[1], p[2]].map(f64::from));
        (y > 0.0 && y.is_finite()).then_some(y)
    };
    let mut values: Vec<f64> = picture.pixels.iter().filter_map(lit).collect();
    if values.is_empty() {
        return 0.0;
    }
    let rank = ((values.len() - 1) as f64 * (1.0 - AUTO_EXPOSURE_TAIL)).floor() as usize;
    let (_, &mut bright, _) = values.select_nth_unstable_by(rank, f64::total_cmp);
    let wanted = match tone {
        ToneCurve::Linear => AUTO_EXPOSURE_TARGET,
        ToneCurve::Filmic => filmic_inverse(AUTO_EXPOSURE_TARGET),
    };
    (wanted / bright).log2() as f32
}

/// Most pixels of a picture that is read: 16384 x 16384.
const MOST_PIXELS: u64 = 1 << 28;

/// Reads a PNG, EXR or HDR as linear radiance premultiplied by alpha. A PNG's sRGB transfer is undone; its exposure
/// and tone curve are not known and stay.
pub fn read_picture(path: &Path) -> Result<Picture> {
    let (file, bytes) = crate::input::open(path, "a PNG, EXR or Radiance HDR picture")?;
    let bad = |problem: String| Error::file(path, problem, "give a PNG, EXR or Radiance HDR picture");
    let reader =
        ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(|e| Error::io(path, "read", e))?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::OpenExr | ImageFormat::Hdr) => {}
        Some(other) => return Err(bad(format!("is a {other:?} picture, which is not supported"))),
        None => return Err(bad("is not a picture of a known format".into())),
    }
    let decoded = crate::input::decode(reader, bytes, MOST_PIXELS).map_err(bad)?;
    let picture = from_decoded(decoded);
    picture.check_finite(path)?;
    Ok(picture)
}

fn from_decoded(decoded: DynamicImage) -> Picture {
    let float = matches!(decoded.color(), ColorType::Rgb32F | ColorType::Rgba32F);
    let decoded = decoded.into_rgba32f();
    let linear = |p: &[f32; 4]| {
        let [r, g, b, a] = p.map(f64::from);
        [srgb_to_linear(r) * a, srgb_to_linear(g) * a, srgb_to_linear(b) * a, a].map(|v| v as f32)
    };
    let pixels = bytemuck::cast_slice::<f32, [f32; 4]>(decoded.as_raw());
    let pixels = if float { pixels.to_vec() } else { pixels.iter().map(linear).collect() };
    Picture { width: decoded.width(), height: decoded.height(), pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_matches_the_standard() {
        // IEC 61966-2-1: 8-bit code 188 is about half the light, code 55 about 3.8 %.
        assert!((srgb_to_linear(188.0 / 255.0) - 0.502_886).abs() < 1e-6);
        assert!((srgb_to_linear(55.0 / 255.0) - 0.038_204).abs() < 1e-6);
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            assert!((srgb_to_linear(srgb_encode(x)) - x).abs() < 1e-6, "{x}");
        }
    }

    #[test]
    fn filmic_curve_is_monotone_keeps_mid_grey_and_stays_below_one() {
        assert!((filmic_curve(FILMIC_PIVOT) - FILMIC_PIVOT).abs() < 1e-12);
        let mut last = -1.0;
        for i in -40..40 {
            let y = filmic_curve(f64::from(i).exp2());
            assert!(y > last || y == 1.0, "2^{i}");
            assert!((0.0..=1.0).contains(&y));
            last = y;
        }
        assert!((filmic_curve(filmic_inverse(0.8)) - 0.8).abs() < 1e-12);
        assert_eq!(filmic_curve(0.0), 0.0);
        assert_eq!(filmic_curve(f64::MAX), 1.0);
    }

    #[test]
    fn filmic_keeps_luminance_and_hue_inside_the_gamut() {
        for rgb in [[0.2, 0.1, 0.05], [30.0, 0.1, 0.1], [0.0, 0.0, 1e6], [1e30, 1.0, 0.0]] {
            let out = filmic(rgb);
            assert!(out.iter().all(|c| (0.0..=1.0 + 1e-9).contains(c)), "{rgb:?} -> {out:?}");
            assert!((luminance(out) - filmic_curve(luminance(rgb))).abs() < 1e-9, "{rgb:?} -> {out:?}");
            // The order of the channels is the coarse hue.
            for (i, j) in [(0, 1), (1, 2), (0, 2)] {
                assert!((rgb[i] - rgb[j]) * (out[i] - out[j]) >= 0.0, "{rgb:?} -> {out:?}");
            }
        }
    }

    #[test]
    fn automatic_exposure_ignores_fireflies_and_unlit_pixels() {
        let mut picture = Picture::filled(64, 64, [0.0, 0.0, 0.0, 1.0]);
        for p in &mut picture.pixels[..1000] {
            *p = [0.05, 0.05, 0.05, 1.0];
        }
        let plain = automatic_stops(&picture, ToneCurve::Linear);
        assert!((plain - (AUTO_EXPOSURE_TARGET as f32 / 0.05).log2()).abs() < 1e-5, "{plain}");
        for p in &mut picture.pixels[2000..2005] {
            *p = [1e9, 1e9, 1e9, 1.0];
        }
        assert_eq!(automatic_stops(&picture, ToneCurve::Linear), plain);
    }

    #[test]
    fn automatic_exposure_of_black_and_of_extreme_pictures_is_finite() {
        for tone in [ToneCurve::Linear, ToneCurve::Filmic] {
            assert_eq!(automatic_stops(&Picture::filled(8, 8, [0.0; 4]), tone), 0.0);
            for radiance in [1e-38, f32::MAX] {
                let picture = Picture::filled(8, 8, [radiance, radiance, radiance, 1.0]);
                let stops = automatic_stops(&picture, tone);
                assert!(stops.is_finite());
                let value = Display::new(stops, tone).encode(picture.pixels[0])[1];
                assert!((value - srgb_encode(AUTO_EXPOSURE_TARGET)).abs() < 1e-3, "{radiance}: {value}");
            }
        }
    }

    #[test]
    fn alpha_is_straight_in_a_png() {
        let display = Display::new(0.0, ToneCurve::Linear);
        let encoded = display.encode([0.25, 0.125, 0.0, 0.5]);
        assert!((srgb_to_linear(encoded[0]) - 0.5).abs() < 1e-6);
        assert!((srgb_to_linear(encoded[1]) - 0.25).abs() < 1e-6);
        assert_eq!(encoded[3], 0.5);
        assert_eq!(display.encode([0.0; 4]), [0.0; 4]);
        let clipped = display.encode([-1.0, 0.0, 2.0, 1.0]);
        assert_eq!((clipped[0], clipped[1], clipped[3]), (0.0, 0.0, 1.0));
        assert!((clipped[2] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn dither_keeps_exact_values_and_the_mean_of_others() {
        let exact = Picture::filled(64, 64, [srgb_to_linear(100.0 / 255.0) as f32, 0.0, 1.0, 1.0]);
        let values = to_8_bit(&exact, 0.0, ToneCurve::Linear);
        assert!(values.chunks(4).all(|p| p == [100, 0, 255, 255]));

        let between = Picture::filled(64, 64, [srgb_to_linear(100.3 / 255.0) as f32, 0.0, 1.0, 1.0]);
        let values = to_8_bit(&between, 0.0, ToneCurve::Linear);
        let mean = values.chunks(4).map(|p| f64::from(p[0])).sum::<f64>() / 4096.0;
        assert!((mean - 100.3).abs() < 0.01, "{mean}");
        // No band: every 8×8 block has the mean too, within a few steps of its 64 thresholds.
        for block in 0..64 {
            let (x0, y0) = (block % 8 * 8, block / 8 * 8);
            let sum: u32 = (0..64).map(|i| u32::from(values[4 * ((y0 + i / 8) * 64 + x0 + i % 8)])).sum();
            assert!((f64::from(sum) / 64.0 - 100.3).abs() < 0.08, "block {block}: {sum}");
        }
    }

    #[test]
    fn dither_steps_are_the_plastic_numbers() {
        let rho = 1.324_717_957_244_746_f64;
        assert!((rho.powi(3) - rho - 1.0).abs() < 1e-12);
        let step = |power: i32| (2f64.powi(32) / rho.powi(power)).round() as u32;
        assert_eq!(dither_threshold(1, 0), f64::from(step(1) >> 24) / 256.0);
        assert_eq!(dither_threshold(0, 1), f64::from(step(2) >> 24) / 256.0);
        assert_eq!(dither_threshold(251, 0), f64::from(step(1).wrapping_mul(251) >> 24) / 256.0);
    }
}
