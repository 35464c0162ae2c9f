//! Light from all around: latitude-longitude images, and the table that samples their bright parts.
//!
//! World z is up. At rotation 0 the image's centre column looks along +y (behind the object, as the default camera
//! sees it), columns to its right turn towards +x, row 0 is at +z. So a viewer at the centre who looks along +y sees
//! the image unmirrored. The rotation turns the image counter-clockwise seen from +z.
//! A texel covers a patch of equal azimuth and polar-angle steps; its radiance is constant over the patch, so sums
//! over texels are exact integrals.

use super::{Environment, LatLong};
use crate::{Error, Result};
use glam::{DVec3, Vec3};
use image::{ImageFormat, ImageReader};
use std::f64::consts::{PI, TAU};
use std::io::BufReader;
use std::path::Path;

/// Most texels of an environment image: 8192×4096 (400 MB while it is decoded).
const MAX_TEXELS: u64 = 1 << 25;
/// Most columns of the sampling table; it has at most half as many rows. Larger images are summed into its cells.
const MAX_TABLE_COLUMNS: u32 = 2048;
/// Share of the table's probability that is spread evenly over the sphere. It keeps the density of dim parts above
/// what f32 cumulative sums resolve next to a sun, so nothing that shines is left out.
const EVEN_SHARE: f64 = 0.05;

/// Rec. 709 luminance of linear RGB.
fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
}

/// Cosine of the polar angle of the upper edge of row `row` of `rows`.
fn row_edge(row: u32, rows: u32) -> f64 {
    (PI * f64::from(row) / f64::from(rows)).cos()
}

/// Solid angle [sr] of one texel in row `row` of an image of `columns` × `rows`.
fn solid_angle(row: u32, columns: u32, rows: u32) -> f64 {
    (row_edge(row, rows) - row_edge(row + 1, rows)) * TAU / f64::from(columns)
}

/// Texel coordinates in [0,1)² to a unit direction, before rotation; inverse of [`to_uv`] for v linear in angle.
fn from_uv(u: f64, cos_polar: f64) -> DVec3 {
    let (s, c) = (TAU * (u - 0.5)).sin_cos();
    let sin_polar = (1.0 - cos_polar * cos_polar).max(0.0).sqrt();
    DVec3::new(sin_polar * s, sin_polar * c, cos_polar)
}

/// Unit direction, before rotation, to (u, v) from 0 to 1: u along the columns, v = polar angle / π.
fn to_uv(d: DVec3) -> (f64, f64) {
    ((d.x.atan2(d.y) / TAU + 0.5).clamp(0.0, 1.0), d.z.clamp(-1.0, 1.0).acos() / PI)
}

/// Index of the cell of [0,1] that `x` falls in.
fn cell(x: f64, cells: u32) -> u32 {
    ((x * f64::from(cells)) as u32).min(cells - 1)
}

impl Environment {
    /// Radiance from the direction `towards` (unit vector, world: away from the scene).
    pub fn radiance(&self, towards: DVec3) -> Vec3 {
        match self {
            Environment::Constant(radiance) => *radiance,
            Environment::LatLong(image) => image.radiance(towards),
        }
    }

    /// Mean radiance over the sphere.
    pub fn mean_radiance(&self) -> Vec3 {
        match self {
            Environment::Constant(radiance) => *radiance,
            Environment::LatLong(image) => image.mean_radiance(),
        }
    }
}

impl LatLong {
    /// Reads a Radiance HDR or OpenEXR image; radiance is multiplied by `strength` ≥ 0.
    ///
    /// NaN and infinite texels are refused; negative ones, which resampling filters leave behind, become 0 with a
    /// warning in the log.
    pub fn load(path: &Path, strength: f32, rotation_degrees: f64) -> Result<Self> {
        let cure = "give a latitude-longitude .hdr or .exr image; scale the image down if it is too large";
        let bad = |problem: String| Error::file(path, problem, cure);
        let (file, bytes) = crate::input::open(path, "a latitude-longitude .hdr or .exr image")?;
        let reader = ImageReader::new(BufReader::new(file)).with_guessed_format();
        let reader = reader.map_err(|e| Error::io(path, "read", e))?;
        if !matches!(reader.format(), Some(ImageFormat::Hdr | ImageFormat::OpenExr)) {
            return Err(bad("is neither Radiance HDR nor OpenEXR".into()));
        }
        let image = crate::input::decode(reader, bytes, MAX_TEXELS).map_err(bad)?;
        let (width, height) = (image.width(), image.height());
        let mut pixels: Vec<[f32; 3]> = image.into_rgb32f().pixels().map(|p| p.0.map(|c| c * strength)).collect();
        let mut negative = 0usize;
        for (i, pixel) in pixels.iter_mut().enumerate() {
            if pixel.iter().any(|c| !c.is_finite()) {
                let (x, y) = (i % width as usize, i / width as usize);
                let problem = format!("the texel in column {x}, row {y} is {pixel:?} (times the strength)");
                return Err(Error::file(path, problem, "repair the image: radiance must be finite"));
            }
            negative += usize::from(pixel.iter().any(|&c| c < 0.0));
            *pixel = pixel.map(|c| c.max(0.0));
        }
        if negative > 0 {
            log::warn!("{}: {negative} texels with negative radiance were set to 0", path.display());
        }
        Ok(Self { width, height, pixels, rotation_degrees })
    }

    /// Radiance from the direction `towards` (unit vector, world).
    pub fn radiance(&self, towards: DVec3) -> Vec3 {
        let (u, v) = to_uv(rotate_z(towards, -self.rotation_degrees));
        let (x, y) = (cell(u, self.width), cell(v, self.height));
        Vec3::from(self.pixels[y as usize * self.width as usize + x as usize])
    }

    /// Mean radiance over the sphere.
    pub fn mean_radiance(&self) -> Vec3 {
        let mut sum = [0.0f64; 3];
        for (y, row) in self.pixels.chunks(self.width as usize).enumerate() {
            let weight = solid_angle(y as u32, self.width, self.height) / (4.0 * PI);
            for c in 0..3 {
                sum[c] += weight * row.iter().map(|p| f64::from(p[c])).sum::<f64>();
            }
        }
        Vec3::from(sum.map(|s| s as f32))
    }
}

/// `d` turned counter-clockwise seen from +z.
fn rotate_z(d: DVec3, degrees: f64) -> DVec3 {
    let (s, c) = degrees.to_radians().sin_cos();
    DVec3::new(c * d.x - s * d.y, s * d.x + c * d.y, d.z)
}

/// Cumulative sums that draw directions by luminance: first a row, then a cell of that row, then a direction even in
/// solid angle within the cell. The density is taken from the same f32 sums, so it matches the draw exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentTable {
    /// Cells in azimuth.
    pub columns: u32,
    /// Cells in polar angle, row 0 at +z.
    pub rows: u32,
    /// Cumulative probability of the rows: `rows + 1` values from 0 to 1.
    pub marginal: Vec<f32>,
    /// Cumulative probability within each row: `rows` × (`columns` + 1) values, each row from 0 to 1.
    pub conditional: Vec<f32>,
    /// As the image's.
    pub rotation_degrees: f64,
}

impl EnvironmentTable {
    /// Builds the table of an image.
    pub fn new(image: &LatLong) -> Self {
        let columns = image.width.min(MAX_TABLE_COLUMNS);
        let rows = image.height.min(MAX_TABLE_COLUMNS / 2);
        // Energy per cell. A texel that straddles cells counts for the one its centre is in: the even share covers
        // the rest of it.
        let mut energy = vec![0.0f64; columns as usize * rows as usize];
        for y in 0..image.height {
            let row = cell((f64::from(y) + 0.5) / f64::from(image.height), rows) as usize * columns as usize;
            let weight = solid_angle(y, image.width, image.height);
            for x in 0..image.width {
                let column = cell((f64::from(x) + 0.5) / f64::from(image.width), columns) as usize;
                let texel = y as usize * image.width as usize + x as usize;
                energy[row + column] += weight * luminance(image.pixels[texel]);
            }
        }
        let total: f64 = energy.iter().sum();
        let even = if total > 0.0 { EVEN_SHARE } else { 1.0 };
        let mut row_sums = Vec::with_capacity(rows as usize);
        let mut conditional = Vec::with_capacity(rows as usize * (columns as usize + 1));
        for (y, row) in energy.chunks_mut(columns as usize).enumerate() {
            let share = even * solid_angle(y as u32, columns, rows) / (4.0 * PI);
            for e in row.iter_mut() {
                *e = share + if total > 0.0 { (1.0 - even) * *e / total } else { 0.0 };
            }
            row_sums.push(row.iter().sum());
            append_cumulative(&mut conditional, row);
        }
        let mut marginal = Vec::with_capacity(rows as usize + 1);
        append_cumulative(&mut marginal, &row_sums);
        Self { columns, rows, marginal, conditional, rotation_degrees: image.rotation_degrees }
    }

    fn row(&self, y: u32) -> &[f32] {
        let stride = self.columns as usize + 1;
        &self.conditional[y as usize * stride..(y as usize + 1) * stride]
    }

    /// Density [1/sr] of a cell: constant over it.
    fn cell_density(&self, x: u32, y: u32) -> f32 {
        let row = self.row(y);
        let probability = |sums: &[f32], i: u32| f64::from(sums[i as usize + 1] - sums[i as usize]);
        let p = probability(&self.marginal, y) * probability(row, x);
        (p / solid_angle(y, self.columns, self.rows)) as f32
    }

    /// Density [1/sr] with which [`Self::sample`] draws the direction `towards` (unit vector, world).
    pub fn density(&self, towards: DVec3) -> f32 {
        let (u, v) = to_uv(rotate_z(towards, -self.rotation_degrees));
        self.cell_density(cell(u, self.columns), cell(v, self.rows))
    }

    /// The direction (unit vector, world, away from the scene) that belongs to `random` in [0,1)², and its density
    /// [1/sr]. `random[0]` chooses the azimuth, `random[1]` the polar angle; both stay stratified.
    pub fn sample(&self, random: [f32; 2]) -> (DVec3, f32) {
        let (y, v) = pick(&self.marginal, random[1]);
        let (x, u) = pick(self.row(y), random[0]);
        let (top, bottom) = (row_edge(y, self.rows), row_edge(y + 1, self.rows));
        let local = from_uv((f64::from(x) + u) / f64::from(self.columns), top + v * (bottom - top));
        (rotate_z(local, self.rotation_degrees), self.cell_density(x, y))
    }
}

/// Appends the normalised cumulative sums of `weights` (their sum > 0): n + 1 values from 0 to exactly 1.
fn append_cumulative(sums: &mut Vec<f32>, weights: &[f64]) {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    sums.push(0.0);
    for w in &weights[..weights.len() - 1] {
        sum += w;
        sums.push(((sum / total) as f32).min(1.0));
    }
    sums.push(1.0);
}

/// The interval of the cumulative `sums` that holds `random`, and the place within it in [0,1). Never one of
/// probability 0.
fn pick(sums: &[f32], random: f32) -> (u32, f64) {
    let above = sums.partition_point(|&s| s <= random).clamp(1, sums.len() - 1);
    let (a, b) = (f64::from(sums[above - 1]), f64::from(sums[above]));
    (above as u32 - 1, ((f64::from(random) - a) / (b - a)).clamp(0.0, 1.0 - f64::EPSILON))
}
