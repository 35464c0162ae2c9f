//! The camera: directions by angles, automatic framing, and the ray of a pixel.
//!
//! Angles are in degrees about the world's z axis. In LPS axes (+x = the patient's left, +y = back, +z = head)
//! azimuth 0 looks at the face: the eye is at −y, and the patient's left is on the picture's right. Azimuth grows
//! counter-clockwise seen from above: 90 puts the eye at +x. Elevation 90 looks down from +z.

use super::Camera;
use crate::volume::Grid;
use glam::{DMat3, DVec3};

/// Share of the picture's half width and half height that the framed box may fill.
const MARGIN: f64 = 0.95;
/// Least depth of the framed box's nearest corner, in half diagonals of the box. A very wide field of view would
/// otherwise fit the box with the eye on that corner.
const NEAREST: f64 = 0.1;

/// A view that fits itself to a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// Where the eye is, see the module. Degrees.
    pub azimuth: f64,
    /// Height of the eye above the horizon, degrees in −90 to 90.
    pub elevation: f64,
    /// Turns the camera clockwise about its line of sight (the picture turns the other way), degrees.
    pub roll: f64,
    /// Magnifies the picture about its centre, as a zoom lens does: the eye stays, the field of view shrinks.
    pub zoom: f64,
    /// Vertical field of view before the zoom, degrees in (0, 180).
    pub fov: f64,
}

impl Default for Framing {
    fn default() -> Self {
        Self { azimuth: 0.0, elevation: 0.0, roll: 0.0, zoom: 1.0, fov: 30.0 }
    }
}

/// Unit vector from the centre towards an eye or a light at these angles (degrees).
pub fn towards(azimuth: f64, elevation: f64) -> DVec3 {
    let (sa, ca) = azimuth.to_radians().sin_cos();
    let (se, ce) = elevation.to_radians().sin_cos();
    DVec3::new(sa * ce, -ca * ce, se)
}

/// The world-space corners of the box of voxel faces.
pub fn corners(grid: &Grid) -> [DVec3; 8] {
    let dims = grid.dims.map(f64::from);
    std::array::from_fn(|corner| {
        let index = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { dims[axis] } else { 0.0 });
        grid.index_to_world.transform_point3(DVec3::from(index))
    })
}

/// What is right, up and forward for a camera at these angles.
fn axes(framing: &Framing) -> [DVec3; 3] {
    let (sa, ca) = framing.azimuth.to_radians().sin_cos();
    let (se, ce) = framing.elevation.to_radians().sin_cos();
    let (sr, cr) = framing.roll.to_radians().sin_cos();
    let forward = -towards(framing.azimuth, framing.elevation);
    // The derivative of the eye's place by elevation: defined at the poles too, where z × forward is not.
    let level_up = DVec3::new(-sa * se, ca * se, ce);
    let level_right = forward.cross(level_up);
    let right = level_right * cr - level_up * sr;
    let up = level_up * cr + level_right * sr;
    [right, up, forward]
}

/// The camera that sees the whole box of voxel faces as large as a margin of 5 % allows, for a picture of
/// `size` = [width, height] pixels (with `zoom` = 1).
pub fn frame(grid: &Grid, framing: &Framing, size: [u32; 2]) -> Camera {
    frame_turning(grid, framing, size, &[0.0])
}

/// The same that goes on seeing the whole box when it is [`turned`](Camera::turned) by any of `turns` (degrees).
pub fn frame_turning(grid: &Grid, framing: &Framing, size: [u32; 2], turns: &[f64]) -> Camera {
    let [right, up, forward] = axes(framing);

    // A corner at (x, y, z) in camera axes about the box's centre is inside if |x − e| ≤ slope·(z + d) with the eye
    // at (e, −d). For each axis the two sides that bind most give the least d and its e.
    let centre = centre(grid);
    // About the centre. That the camera turns is that the box turns back.
    let turned_back = |&turn: &f64| {
        let back = DMat3::from_rotation_z(-turn.to_radians());
        corners(grid).map(|corner| back * (corner - centre))
    };
    let corners: Vec<DVec3> = turns.iter().flat_map(turned_back).collect();
    let tan = (0.5 * framing.fov).to_radians().tan();
    let fit = |axis: DVec3, slope: f64| {
        let most = |sign: f64| {
            let side = |c: &DVec3| sign * c.dot(axis) - slope * c.dot(forward);
            corners.iter().map(side).fold(f64::NEG_INFINITY, f64::max)
        };
        let (plus, minus) = (most(1.0), most(-1.0));
        ((plus + minus) / (2.0 * slope), (plus - minus) / 2.0)
    };
    let aspect = f64::from(size[0]) / f64::from(size[1]);
    let (distance_x, shift_x) = fit(right, MARGIN * tan * aspect);
    let (distance_y, shift_y) = fit(up, MARGIN * tan);
    let nearest = corners.iter().map(|c| c.dot(forward)).fold(f64::INFINITY, f64::min);
    let least = NEAREST * corners[0].length() - nearest;
    let distance = distance_x.max(distance_y).max(least);
    let position = centre + right * shift_x + up * shift_y - forward * distance;
    Camera { position, forward, right, up, fov_degrees: zoomed_fov(framing) }
}

fn zoomed_fov(framing: &Framing) -> f64 {
    let tan = (0.5 * framing.fov).to_radians().tan();
    2.0 * (tan / framing.zoom).atan().to_degrees()
}

/// The camera of `framing` on a way that leads through `all` angles: it looks at the box's centre, from a distance at which
/// the whole box is seen from every one of them (with `zoom` = 1), so that the box does not swell and shrink on the way.
pub fn frame_moving(grid: &Grid, framing: &Framing, size: [u32; 2], all: &[Framing]) -> Camera {
    let centre = centre(grid);
    let corners = corners(grid).map(|corner| corner - centre);
    let slope_y = MARGIN * (0.5 * framing.fov).to_radians().tan();
    let slope_x = slope_y * f64::from(size[0]) / f64::from(size[1]);
    let needed = |angles: &Framing| {
        let [right, up, forward] = axes(angles);
        let of = |c: &DVec3| {
            let least = NEAREST * corners[0].length();
            (c.dot(right).abs() / slope_x).max(c.dot(up).abs() / slope_y).max(least) - c.dot(forward)
        };
        corners.iter().map(of).fold(0.0, f64::max)
    };
    let distance = all.iter().map(needed).fold(needed(framing), f64::max);
    let [right, up, forward] = axes(framing);
    Camera { position: centre - forward * distance, forward, right, up, fov_degrees: zoomed_fov(framing) }
}

/// The camera at `position` that looks at `target` ≠ `position`, with `up` upwards in the picture. If the line of
/// sight is along `up`, +y (looking down) or −y (looking up) takes its place, as automatic framing does; else z.
pub fn look_at(position: DVec3, target: DVec3, up: DVec3, fov_degrees: f64) -> Camera {
    let forward = (target - position).normalize();
    let candidates = [up.normalize(), DVec3::Y * -forward.z.signum(), DVec3::Z];
    let usable = |c: &&DVec3| forward.cross(**c).length() > 1e-9;
    let up = candidates.iter().find(usable).expect("y and z are not both along the line of sight");
    let right = forward.cross(*up).normalize();
    Camera { position, forward, right, up: right.cross(forward), fov_degrees }
}

/// Centre of the box of voxel faces, world.
pub fn centre(grid: &Grid) -> DVec3 {
    corners(grid).iter().sum::<DVec3>() / 8.0
}

impl Camera {
    /// This camera gone around the vertical axis through `centre` by so many degrees, counter-clockwise seen from above.
    pub fn turned(&self, centre: DVec3, degrees: f64) -> Self {
        let turn = DMat3::from_rotation_z(degrees.to_radians());
        Self {
            position: centre + turn * (self.position - centre),
            forward: turn * self.forward,
            right: turn * self.right,
            up: turn * self.up,
            fov_degrees: self.fov_degrees,
        }
    }

    /// Unit direction of the ray through (`px`, `py`) of a picture of `size` = [width, height] pixels. Pixel i covers
    /// [i, i+1); row 0 is on top; (width/2, height/2) is the line of sight. Pixels are square.
    pub fn ray(&self, px: f64, py: f64, size: [u32; 2]) -> DVec3 {
        let [width, height] = size.map(f64::from);
        let tan = (0.5 * self.fov_degrees).to_radians().tan();
        let x = (2.0 * px - width) / height * tan;
        let y = (height - 2.0 * py) / height * tan;
        (self.forward + self.right * x + self.up * y).normalize()
    }
}
