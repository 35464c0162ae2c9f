//! One asymmetric volume, written in every format, byte order, packing and axis order, must load to the same values at
//! the same places of the world; damaged and absurd files must give one clear error.
//!
//! The writers below state the formats a second time, from their definitions, so that reader and writer check each
//! other.

use clap::ValueEnum;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use proptest::prelude::*;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use tyndall::volume::{self, RawLayout, ScalarType, Volume, VoxelData};

/// What is written: values and their place in LPS.
#[derive(Clone)]
struct Image {
    dims: [usize; 3],
    values: Vec<f64>,
    /// World vectors of the voxel steps.
    steps: DMat3,
    /// World position of voxel 0's centre.
    origin: DVec3,
}

impl Image {
    /// Different sizes, spacings and values along every axis, no symmetry anywhere.
    fn asymmetric(rotation: DMat3) -> Self {
        let dims = [4, 3, 5];
        let values = (0..60).map(|i| f64::from(i * 7 % 61 + 1)).collect();
        let spacing = DMat3::from_diagonal(DVec3::new(0.75, 1.25, 2.5));
        Self { dims, values, steps: rotation * spacing, origin: DVec3::new(-12.5, 40.25, 7.0) }
    }

    fn voxel(&self, i: usize) -> [usize; 3] {
        [i % self.dims[0], i / self.dims[0] % self.dims[1], i / self.dims[0] / self.dims[1]]
    }

    fn world(&self, voxel: [usize; 3]) -> DVec3 {
        self.origin + self.steps * DVec3::from(voxel.map(|v| v as f64))
    }

    /// The same body stored with axis `a` running along the old axis `order[a]`, backwards if `flip[a]`.
    fn stored_as(&self, order: [usize; 3], flip: [bool; 3]) -> Self {
        let dims = order.map(|axis| self.dims[axis]);
        let old_voxel = |new: [usize; 3]| {
            let mut old = [0; 3];
            for a in 0..3 {
                old[order[a]] = if flip[a] { dims[a] - 1 - new[a] } else { new[a] };
            }
            old
        };
        let step = |a: usize| self.steps.col(order[a]) * if flip[a] { -1.0 } else { 1.0 };
        let mut new = Self {
            dims,
            values: Vec::new(),
            steps: DMat3::from_cols(step(0), step(1), step(2)),
            origin: self.world(old_voxel([0; 3])),
        };
        for i in 0..self.values.len() {
            let [x, y, z] = old_voxel(new.voxel(i));
            new.values.push(self.values[x + self.dims[0] * (y + self.dims[1] * z)]);
        }
        new
    }

    /// All 48 ways to store it.
    fn orientations(&self) -> impl Iterator<Item = Self> {
        let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        orders.into_iter().flat_map(move |order| {
            (0..8).map(move |bits| self.stored_as(order, [bits & 1 == 1, bits & 2 == 2, bits & 4 == 4]))
        })
    }

    fn bytes(&self, scalar: ScalarType, big: bool) -> Vec<u8> {
        let mut out = Vec::new();
        for &v in &self.values {
            let mut b = match scalar {
                ScalarType::U8 => (v as u8).to_le_bytes().to_vec(),
                ScalarType::I8 => (v as i8).to_le_bytes().to_vec(),
                ScalarType::U16 => (v as u16).to_le_bytes().to_vec(),
                ScalarType::I16 => (v as i16).to_le_bytes().to_vec(),
                ScalarType::U32 => (v as u32).to_le_bytes().to_vec(),
                ScalarType::I32 => (v as i32).to_le_bytes().to_vec(),
                ScalarType::F32 => (v as f32).to_le_bytes().to_vec(),
                ScalarType::F64 => v.to_le_bytes().to_vec(),
            };
            if big {
                b.reverse();
            }
            out.extend(b);
        }
        out
    }
}

/// Every voxel of `image` must be found at its world point, at a voxel centre, with its value.
fn assert_same_world(image: &Image, loaded: &Volume, context: &str) {
    let to_index = loaded.grid.index_to_world.inverse();
    for i in 0..image.values.len() {
        let world = image.world(image.voxel(i));
        let index = to_index.transform_point3(world) - DVec3::splat(0.5);
        let nearest = index.round();
        assert!((index - nearest).abs().max_element() < 1e-4, "{context}: {world} is at index {index}, off centre");
        let [dx, dy, dz] = loaded.grid.dims.map(f64::from);
        let inside = nearest.cmpge(DVec3::ZERO).all() && nearest.cmplt(DVec3::new(dx, dy, dz)).all();
        assert!(inside, "{context}: {world} is at index {index}, outside {:?}", loaded.grid.dims);
        let value = loaded.value((nearest.x + dx * (nearest.y + dy * nearest.z)) as usize);
        assert_eq!(value, image.values[i], "{context}: value at {world}");
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn write(path: PathBuf, parts: &[&[u8]]) -> PathBuf {
    fs::write(&path, parts.concat()).unwrap();
    path
}

#[derive(Clone, Copy, Debug)]
struct Nrrd {
    detached: bool,
    gzip: bool,
    big: bool,
    space: &'static str,
    /// Signs from LPS to that space.
    signs: [f64; 3],
}

fn nrrd_type(scalar: ScalarType) -> &'static str {
    match scalar {
        ScalarType::U8 => "unsigned char",
        ScalarType::I8 => "int8",
        ScalarType::U16 => "ushort",
        ScalarType::I16 => "short",
        ScalarType::U32 => "uint32_t",
        ScalarType::I32 => "int",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    }
}

fn write_nrrd(image: &Image, dir: &Path, scalar: ScalarType, form: Nrrd) -> PathBuf {
    let signs = DMat3::from_diagonal(DVec3::from(form.signs));
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let steps = signs * image.steps;
    let [x, y, z] = image.dims;
    let mut header = format!(
        "NRRD0004\n# a comment: with a colon\ntype: {}\ndimension: 3\nspace: {}\nsizes: {x} {y} {z}\n\
         space directions: {} {} {}\nkinds: domain domain domain\nendian: {}\nencoding: {}\n\
         space origin: {}\nmy key:=some: value\n",
        nrrd_type(scalar),
        form.space,
        vector(steps.x_axis),
        vector(steps.y_axis),
        vector(steps.z_axis),
        if form.big { "big" } else { "little" },
        if form.gzip { "gzip" } else { "raw" },
        vector(signs * image.origin),
    );
    let data = image.bytes(scalar, form.big);
    if !form.detached {
        let packed = if form.gzip { gzip(&data) } else { data };
        return write(dir.join("attached.nrrd"), &[header.as_bytes(), b"\n", &packed]);
    }
    // Two lines to skip before and three bytes behind the packing, as the definition counts them.
    fs::create_dir_all(dir.join("sub")).unwrap();
    header += "line skip: 2\nbyte skip: 3\ndata file: sub/data.bin\n";
    let data = [b"abc", &data[..]].concat();
    let packed = if form.gzip { gzip(&data) } else { data };
    write(dir.join("sub/data.bin"), &[b"first line\nsecond\n", &packed]);
    write(dir.join("detached.nhdr"), &[header.as_bytes()])
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum MetaData {
    Local,
    File,
    /// The header's size is stated.
    Skip,
    /// The data are at the end.
    AtEnd,
}

#[derive(Clone, Copy, Debug)]
struct Meta {
    data: MetaData,
    zlib: bool,
    big: bool,
}

fn meta_type(scalar: ScalarType) -> &'static str {
    match scalar {
        ScalarType::U8 => "MET_UCHAR",
        ScalarType::I8 => "MET_CHAR",
        ScalarType::U16 => "MET_USHORT",
        ScalarType::I16 => "MET_SHORT",
        ScalarType::U32 => "MET_UINT",
        ScalarType::I32 => "MET_INT",
        ScalarType::F32 => "MET_FLOAT",
        ScalarType::F64 => "MET_DOUBLE",
    }
}

fn write_meta(image: &Image, dir: &Path, scalar: ScalarType, form: Meta) -> PathBuf {
    let [x, y, z] = image.dims;
    let steps = [image.steps.x_axis, image.steps.y_axis, image.steps.z_axis];
    let spacing = steps.map(|s| s.length());
    let mut matrix = String::new();
    for step in steps {
        let d = step.normalize();
        write!(matrix, " {} {} {}", d.x, d.y, d.z).unwrap();
    }
    let o = image.origin;
    let mut header = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\n{} = {}\nCompressedData = {}\nTransformMatrix ={matrix}\n\
         {} = {} {} {}\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = LPS\nElementSpacing = {} {} {}\n\
         DimSize = {x} {y} {z}\nElementType = {}\n",
        if form.data == MetaData::Local { "BinaryDataByteOrderMSB" } else { "ElementByteOrderMSB" },
        if form.big { "True" } else { "False" },
        if form.zlib { "True" } else { "False" },
        if form.zlib { "Offset" } else { "Position" },
        o.x,
        o.y,
        o.z,
        spacing[0],
        spacing[1],
        spacing[2],
        meta_type(scalar),
    );
    let data = image.bytes(scalar, form.big);
    let packed = if form.zlib { zlib(&data) } else { data };
    let before: &[u8] = match form.data {
        MetaData::Local => {
            header += "ElementDataFile = LOCAL\n";
            return write(dir.join("local.mha"), &[header.as_bytes(), &packed]);
        }
        MetaData::File => b"",
        MetaData::Skip => {
            header += "HeaderSize = 5\n";
            b"12345"
        }
        MetaData::AtEnd => {
            header += "HeaderSize = -1\n";
            b"any length"
        }
    };
    header += "ElementDataFile = data.bin\n";
    write(dir.join("data.bin"), &[before, &packed]);
    write(dir.join("detached.mhd"), &[header.as_bytes()])
}

#[derive(Clone, Copy, Debug)]
struct Nifti {
    version: u8,
    gzip: bool,
    big: bool,
    qform: bool,
    pair: bool,
    scaling: (f64, f64),
}

const PLAIN_NIFTI: Nifti =
    Nifti { version: 1, gzip: false, big: false, qform: false, pair: false, scaling: (0.0, 0.0) };

/// Header bytes; `put` places a number at its offset in NIfTI-1 and in NIfTI-2.
struct NiftiBytes {
    bytes: Vec<u8>,
    form: Nifti,
}

impl NiftiBytes {
    fn raw(&mut self, at: usize, mut b: Vec<u8>) {
        if self.form.big {
            b.reverse();
        }
        self.bytes[at..at + b.len()].copy_from_slice(&b);
    }

    fn short(&mut self, at: [usize; 2], value: i16) {
        self.raw(at[usize::from(self.form.version) - 1], value.to_le_bytes().to_vec());
    }

    /// An i16 in version 1, i64 in version 2.
    fn dim(&mut self, i: usize, value: i64) {
        match self.form.version {
            1 => self.raw(40 + 2 * i, (value as i16).to_le_bytes().to_vec()),
            _ => self.raw(16 + 8 * i, value.to_le_bytes().to_vec()),
        }
    }

    /// An i16 in version 1, i32 in version 2.
    fn code(&mut self, at: [usize; 2], value: i16) {
        match self.form.version {
            1 => self.raw(at[0], value.to_le_bytes().to_vec()),
            _ => self.raw(at[1], i32::from(value).to_le_bytes().to_vec()),
        }
    }

    /// An f32 in version 1, f64 in version 2.
    fn real(&mut self, at: [usize; 2], i: usize, value: f64) {
        match self.form.version {
            1 => self.raw(at[0] + 4 * i, (value as f32).to_le_bytes().to_vec()),
            _ => self.raw(at[1] + 8 * i, value.to_le_bytes().to_vec()),
        }
    }
}

fn nifti_type(scalar: ScalarType) -> i16 {
    match scalar {
        ScalarType::U8 => 2,
        ScalarType::I16 => 4,
        ScalarType::I32 => 8,
        ScalarType::F32 => 16,
        ScalarType::F64 => 64,
        ScalarType::I8 => 256,
        ScalarType::U16 => 512,
        ScalarType::U32 => 768,
    }
}

fn nifti_header(image: &Image, scalar: ScalarType, form: Nifti) -> Vec<u8> {
    let size = if form.version == 1 { 348 } else { 540 };
    let mut h = NiftiBytes { bytes: vec![0; size], form };
    h.raw(0, (size as u32).to_le_bytes().to_vec());
    h.short([70, 12], nifti_type(scalar));
    h.short([72, 14], 8 * scalar.size() as i16);
    h.dim(0, 3);
    for a in 0..3 {
        h.dim(a + 1, image.dims[a] as i64);
    }
    for i in 4..8 {
        h.dim(i, 1);
    }
    // An extension of 16 bytes stands between header and data.
    let offset = if form.pair { 0 } else { size as i64 + 4 + 16 };
    match form.version {
        1 => h.raw(108, (offset as f32).to_le_bytes().to_vec()),
        _ => h.raw(168, offset.to_le_bytes().to_vec()),
    }
    h.real([112, 176], 0, form.scaling.0);
    h.real([112, 176], 1, form.scaling.1);

    let lps_to_ras = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let mut steps = lps_to_ras * image.steps;
    let origin = lps_to_ras * image.origin;
    for a in 0..3 {
        h.real([76, 104], a + 1, steps.col(a).length());
    }
    if form.qform {
        let qfac = steps.determinant().signum();
        h.real([76, 104], 0, qfac);
        steps.z_axis *= qfac;
        let rotation = DMat3::from_cols(steps.x_axis.normalize(), steps.y_axis.normalize(), steps.z_axis.normalize());
        let q = DQuat::from_mat3(&rotation);
        let q = if q.w < 0.0 { -q } else { q };
        for (i, number) in [q.x, q.y, q.z, origin.x, origin.y, origin.z].into_iter().enumerate() {
            h.real([256, 352], i, number);
        }
        h.code([252, 344], 1);
    } else {
        for row in 0..3 {
            for column in 0..3 {
                h.real([280, 400], 4 * row + column, steps.row(row)[column]);
            }
            h.real([280, 400], 4 * row + 3, origin[row]);
        }
        h.code([254, 348], 1);
        // The sform goes before the qform, whose offsets and quaternion say something else here.
        h.code([252, 344], 1);
    }
    let magic = if form.version == 1 { 344 } else { 4 };
    let kind = if form.pair { "ni" } else { "n+" };
    h.bytes[magic..magic + 4].copy_from_slice(format!("{kind}{}\0", form.version).as_bytes());
    h.bytes
}

fn write_nifti(image: &Image, dir: &Path, scalar: ScalarType, form: Nifti) -> PathBuf {
    let header = nifti_header(image, scalar, form);
    let data = image.bytes(scalar, form.big);
    if form.pair {
        write(dir.join("pair.img"), &[&data]);
        return write(dir.join("pair.hdr"), &[&header]);
    }
    let extension = [[1, 0, 0, 0].as_slice(), &[7; 16]].concat();
    let whole = [&header[..], &extension, &data].concat();
    if form.gzip { write(dir.join("v.nii.gz"), &[&gzip(&whole)]) } else { write(dir.join("v.nii"), &[&whole]) }
}

type Writer = Box<dyn Fn(&Image, &Path, ScalarType) -> PathBuf>;

/// Every format in every packing, with its name.
fn writers() -> Vec<(String, Writer)> {
    let mut all: Vec<(String, Writer)> = Vec::new();
    let spaces = [
        ("left-posterior-superior", [1.0, 1.0, 1.0]),
        ("LPS", [1.0, 1.0, 1.0]),
        ("right-anterior-superior", [-1.0, -1.0, 1.0]),
        ("RAS", [-1.0, -1.0, 1.0]),
        ("left-anterior-superior", [1.0, -1.0, 1.0]),
        ("LAS", [1.0, -1.0, 1.0]),
        ("3D-right-handed", [1.0, 1.0, 1.0]),
    ];
    for (i, (space, signs)) in spaces.into_iter().enumerate() {
        for detached in [false, true] {
            let form = Nrrd { detached, gzip: i % 2 == 1, big: i % 3 == 1, space, signs };
            all.push((format!("{form:?}"), Box::new(move |v, d, s| write_nrrd(v, d, s, form))));
        }
    }
    for (data, zlib, big) in [
        (MetaData::Local, false, false),
        (MetaData::Local, true, true),
        (MetaData::File, false, true),
        (MetaData::File, true, false),
        (MetaData::Skip, false, false),
        (MetaData::Skip, true, false),
        (MetaData::AtEnd, false, true),
    ] {
        let form = Meta { data, zlib, big };
        all.push((format!("{form:?}"), Box::new(move |v, d, s| write_meta(v, d, s, form))));
    }
    for version in [1, 2] {
        for (gzip, big, qform, pair) in [
            (false, false, false, false),
            (false, true, true, false),
            (true, false, true, false),
            (true, true, false, false),
            (false, false, true, true),
        ] {
            let form = Nifti { version, gzip, big, qform, pair, ..PLAIN_NIFTI };
            all.push((format!("{form:?}"), Box::new(move |v, d, s| write_nifti(v, d, s, form))));
        }
    }
    all
}

#[test]
fn every_format_and_orientation_loads_to_the_same_world() {
    let dir = tempfile::tempdir().unwrap();
    let oblique = DMat3::from_euler(EulerRot::ZYX, 0.4, -0.7, 1.1);
    for rotation in [DMat3::IDENTITY, oblique] {
        let body = Image::asymmetric(rotation);
        for (name, writer) in writers() {
            for (i, image) in body.orientations().enumerate() {
                let context = format!("{name}, orientation {i}, oblique {}", rotation != DMat3::IDENTITY);
                let path = writer(&image, dir.path(), ScalarType::I16);
                let loaded = volume::load(&path, None).unwrap_or_else(|e| panic!("{context}: {e}"));
                assert_eq!(loaded.grid.dims.map(|d| d as usize), image.dims, "{context}");
                // The body as it was before it was stored in this order.
                assert_same_world(&body, &loaded, &context);
            }
        }
    }
}

#[test]
fn every_scalar_type_keeps_its_extremes() {
    let dir = tempfile::tempdir().unwrap();
    for &scalar in ScalarType::value_variants() {
        let (least, greatest) = match scalar {
            ScalarType::U8 => (0.0, f64::from(u8::MAX)),
            ScalarType::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
            ScalarType::U16 => (0.0, f64::from(u16::MAX)),
            ScalarType::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
            ScalarType::U32 => (0.0, f64::from(u32::MAX)),
            ScalarType::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
            ScalarType::F32 => (f64::from(-1.0e-40f32), f64::from(f32::MAX)),
            ScalarType::F64 => (-1.0e-310, f64::MAX),
        };
        let mut image = Image::asymmetric(DMat3::IDENTITY);
        image.values[0] = least;
        image.values[59] = greatest;
        for (name, writer) in writers() {
            let loaded = volume::load(&writer(&image, dir.path(), scalar), None).unwrap();
            assert_eq!(loaded.data.scalar_type(), scalar, "{name}");
            assert_same_world(&image, &loaded, &format!("{scalar} {name}"));
        }
        for big_endian in [false, true] {
            let path = write(dir.path().join("v.raw"), &[b"header", &image.bytes(scalar, big_endian)]);
            let layout = RawLayout {
                dims: [4, 3, 5],
                scalar,
                big_endian,
                spacing: [0.75, 1.25, 2.5],
                origin: image.origin.to_array(),
                skip: 6,
            };
            let loaded = volume::load(&path, Some(&layout)).unwrap();
            assert_eq!(loaded.data.scalar_type(), scalar);
            assert_same_world(&image, &loaded, &format!("{scalar} raw, big endian {big_endian}"));
        }
    }
}

#[test]
fn scalar_types_print_as_they_are_written() {
    for scalar in ScalarType::value_variants() {
        assert_eq!(scalar.to_possible_value().unwrap().get_name(), scalar.to_string());
    }
}

#[test]
fn nifti_scaling_applies() {
    let dir = tempfile::tempdir().unwrap();
    for (version, big) in [(1, false), (1, true), (2, false), (2, true)] {
        let mut image = Image::asymmetric(DMat3::IDENTITY);
        let form = Nifti { version, big, scaling: (2.5, -1024.0), ..PLAIN_NIFTI };
        let path = write_nifti(&image, dir.path(), ScalarType::U8, form);
        image.values.iter_mut().for_each(|v| *v = 2.5 * *v - 1024.0);
        let loaded = volume::load(&path, None).unwrap();
        assert_same_world(&image, &loaded, &format!("{form:?}"));
        // The stored scalars stay what they were.
        assert_eq!(loaded.data.scalar_type(), ScalarType::U8);
    }
    // A slope of 0 or NaN means: not scaled, whatever the intercept.
    for slope in [0.0, f64::NAN] {
        let image = Image::asymmetric(DMat3::IDENTITY);
        let form = Nifti { scaling: (slope, 99.0), ..PLAIN_NIFTI };
        let loaded = volume::load(&write_nifti(&image, dir.path(), ScalarType::U8, form), None).unwrap();
        assert_same_world(&image, &loaded, "slope 0");
    }
}

#[test]
fn files_without_directions_lie_along_the_axes() {
    let dir = tempfile::tempdir().unwrap();
    let mut image = Image::asymmetric(DMat3::IDENTITY);
    let data = image.bytes(ScalarType::U8, false);

    image.origin = DVec3::ZERO;
    let text = "NRRD0001\ntype: uchar\ndimension: 3\nsizes: 4 3 5\nspacings: 0.75 1.25 2.5\nencoding: raw\n\n";
    let path = write(dir.path().join("v.nrrd"), &[text.as_bytes(), &data]);
    assert_same_world(&image, &volume::load(&path, None).unwrap(), "nrrd spacings");
    let crlf = text.replace('\n', "\r\n");
    let path = write(dir.path().join("v.nrrd"), &[crlf.as_bytes(), &data]);
    assert_same_world(&image, &volume::load(&path, None).unwrap(), "nrrd with CR LF");

    // Raw data at the end of the file.
    let text = text.replace("encoding", "byte skip: -1\nencoding");
    let path = write(dir.path().join("v.nrrd"), &[text.as_bytes(), b"something else", &data]);
    assert_same_world(&image, &volume::load(&path, None).unwrap(), "nrrd byte skip -1");

    // A NIfTI file with neither sform nor qform: x to the right, y to the front, voxel 0 at 0.
    let mut header = nifti_header(&image, ScalarType::U8, PLAIN_NIFTI);
    header[252..256].fill(0);
    let path = write(dir.path().join("v.nii"), &[&header, &[0; 20], &data]);
    let mut ras = image.clone();
    ras.steps = DMat3::from_diagonal(DVec3::new(-0.75, -1.25, 2.5));
    assert_same_world(&ras, &volume::load(&path, None).unwrap(), "nifti pixdim");

    // A left-handed space is turned, not kept, so that nothing is mirrored.
    let text = "NRRD0004\ntype: uchar\ndimension: 3\nspace: 3D-left-handed\nsizes: 4 3 5\n\
                space directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\n\n";
    let path = write(dir.path().join("v.nrrd"), &[text.as_bytes(), &data]);
    let loaded = volume::load(&path, None).unwrap();
    assert!(loaded.grid.index_to_world.matrix3.determinant() < 0.0);

    // Without a matrix the letters say where each axis comes from.
    let text = "NDims = 3\nDimSize = 4 3 5\nElementType = MET_UCHAR\nElementSize = 0.75 1.25 2.5\n\
                AnatomicalOrientation = ASL\nElementDataFile = LOCAL\n";
    let path = write(dir.path().join("v.mha"), &[text.as_bytes(), &data]);
    let mut asl = image.clone();
    asl.steps = DMat3::from_cols(DVec3::Y * 0.75, DVec3::NEG_Z * 1.25, DVec3::NEG_X * 2.5);
    assert_same_world(&asl, &volume::load(&path, None).unwrap(), "AnatomicalOrientation");
}

#[test]
fn gzip_in_several_members_and_trailing_bytes_load() {
    let dir = tempfile::tempdir().unwrap();
    let image = Image::asymmetric(DMat3::IDENTITY);
    let whole = fs::read(write_nifti(&image, dir.path(), ScalarType::I16, PLAIN_NIFTI)).unwrap();
    let (a, b) = whole.split_at(410);
    let path = write(dir.path().join("v.nii.gz"), &[&gzip(a), &gzip(b), b"bytes behind the last member"]);
    assert_same_world(&image, &volume::load(&path, None).unwrap(), "two members");

    for (name, writer) in writers() {
        let path = writer(&image, dir.path(), ScalarType::I16);
        if name.contains("AtEnd") {
            continue; // Bytes behind the data would be taken for data: that is what the field asks for.
        }
        for file in [path.clone(), dir.path().join("sub/data.bin"), dir.path().join("data.bin")] {
            if !file.exists() || file.extension().is_some_and(|e| e == "nhdr" || e == "mhd") {
                continue;
            }
            let longer = [fs::read(&file).unwrap(), b"trailing".to_vec()].concat();
            fs::write(&file, longer).unwrap();
        }
        let loaded = volume::load(&path, None).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_same_world(&image, &loaded, &name);
    }
}

/// Loads and returns the error's text, which must be one line of problem and one of cure.
fn error_of(path: &Path, raw: Option<&RawLayout>) -> String {
    let error = volume::load(path, raw).map(|v| v.grid).expect_err("loading must fail");
    assert_eq!(error.exit_code(), 1);
    let text = error.to_string();
    assert!(text.contains(path.file_stem().unwrap().to_str().unwrap()), "names no file: {text}");
    text
}

fn assert_parts(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "'{part}' is missing in: {text}");
    }
}

const NRRD: &str = "NRRD0004\ntype: short\ndimension: 3\nspace: LPS\nsizes: 4 3 5\n\
    space directions: (1,0,0) (0,1,0) (0,0,1)\nendian: little\nencoding: raw\nspace origin: (0,0,0)\n";

const META: &str = "NDims = 3\nDimSize = 4 3 5\nElementType = MET_SHORT\nElementSpacing = 1 1 1\n\
    TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nHeaderSize = 0\nElementDataFile = LOCAL\n";

#[test]
fn wrong_nrrd_headers_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("wrong.nrrd");
    let cases: &[(&str, &str, &[&str])] = &[
        ("NRRD0004", "NRRD0009", &["NRRD0001 to NRRD0005"]),
        ("type: short", "type: block", &["'type'", "block"]),
        ("type: short\n", "", &["'type'", "lacks"]),
        ("type: short\n", "type: short\ntype: short\n", &["'type'", "twice"]),
        ("type: short\n", "no field here\n", &["no field here", "field: value"]),
        ("dimension: 3", "dimension: 4", &["'dimension'", "4 dimensions", "unu slice"]),
        ("dimension: 3", "dimension: three", &["'dimension'", "three"]),
        ("sizes: 4 3 5", "sizes: 4 3", &["'sizes'", "2 values instead of 3"]),
        ("sizes: 4 3 5", "sizes: 4 0 5", &["'sizes'", "4 x 0 x 5", "zero"]),
        ("sizes: 4 3 5", "sizes: 4 -3 5", &["'sizes'", "-3"]),
        ("sizes: 4 3 5", "sizes: 4 3 99999999999999999999", &["'sizes'"]),
        ("sizes: 4 3 5", "sizes: 65536 65536 1", &["'sizes'", "4294967295"]),
        ("sizes: 4 3 5", "sizes: 18446744073709551615 2 1", &["'sizes'", "more than"]),
        ("sizes: 4 3 5", "sizes: 4 3 6", &["wrong.nrrd", "promises 72 voxels", "only 120 bytes"]),
        ("encoding: raw", "encoding: ascii", &["'encoding'", "ascii", "unu save"]),
        ("encoding: raw", "encoding: bzip2", &["'encoding'", "bzip2", "unu save"]),
        ("endian: little\n", "", &["'endian'", "missing"]),
        ("endian: little", "endian: middle", &["'endian'", "middle"]),
        ("space: LPS", "space: upside-down", &["'space'", "upside-down", "left-posterior-superior"]),
        ("space: LPS", "space dimension: 4", &["'space dimension'"]),
        ("(0,1,0)", "none", &["'space directions'", "none"]),
        ("(0,1,0)", "(0,1)", &["'space directions'", "(0,1)"]),
        ("(0,1,0)", "(0,0,0)", &["'space directions'", "step 1", "length 0"]),
        ("(0,1,0)", "(0,nan,0)", &["'space directions'", "step 1", "NaN"]),
        ("(0,1,0)", "(0,1e400,0)", &["'space directions'", "step 1"]),
        ("(0,1,0)", "(2,0,0)", &["'space directions'", "singular"]),
        ("space origin: (0,0,0)", "space origin: (0,inf,0)", &["'space origin'", "not finite"]),
        ("space directions: (1,0,0) (0,1,0) (0,0,1)", "spacings: 1 0 1", &["'spacings'", "not positive"]),
        ("space directions: (1,0,0) (0,1,0) (0,0,1)", "spacings: 1 -1 1", &["'spacings'", "not positive"]),
        ("space directions: (1,0,0) (0,1,0) (0,0,1)", "spacings: 1 NaN 1", &["'spacings'", "not positive"]),
        ("space: LPS", "kinds: RGB-color domain domain", &["'kinds'", "RGB-color"]),
        ("encoding: raw", "encoding: raw\nbyte skip: -2", &["'byte skip'", "-2"]),
        ("encoding: raw", "encoding: gzip\nbyte skip: -1", &["'byte skip'", "-1"]),
        ("encoding: raw", "encoding: raw\nline skip: 9", &["wrong.nrrd", "9 lines to skip"]),
        ("encoding: raw", "encoding: raw\ndata file: wrong.absent", &["wrong.absent", "cannot open"]),
        ("encoding: raw", "encoding: raw\ndata file: .", &["not a regular file"]),
        ("encoding: raw", "encoding: raw\ndata file: slice%03d.raw 1 9 1", &["'data file'", "several files"]),
        ("encoding: raw", "encoding: raw\ndata file: LIST", &["'data file'", "several files"]),
    ];
    for (from, to, parts) in cases {
        assert!(NRRD.contains(from), "{from}");
        write(path.clone(), &[NRRD.replace(from, to).as_bytes(), b"\n", &[0; 120]]);
        // The data file is named where it is at fault.
        let text = volume::load(&path, None).map(|v| v.grid).expect_err(to).to_string();
        assert_parts(&text, parts);
        assert!(text.contains("cure: ") || text.contains("cannot open"), "{text}");
    }
    write(path.clone(), &[NRRD.as_bytes()]);
    assert_parts(&error_of(&path, None), &["does not end", "empty line"]);
    // Without any of these faults the same header loads.
    write(path.clone(), &[NRRD.as_bytes(), b"\n", &[0; 120]]);
    volume::load(&path, None).unwrap();
}

#[test]
fn wrong_metaimage_headers_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("wrong.mha");
    let cases: &[(&str, &str, &[&str])] = &[
        ("NDims = 3", "NDims = 4", &["'NDims'", "4 dimensions"]),
        ("NDims = 3\n", "", &["'NDims'", "lacks"]),
        ("NDims = 3\n", "NDims 3\n", &["NDims 3", "Field = value"]),
        ("DimSize = 4 3 5", "DimSize = 4 3", &["'DimSize'", "2 values instead of 3"]),
        ("DimSize = 4 3 5", "DimSize = 4 3 0", &["'DimSize'", "zero"]),
        ("DimSize = 4 3 5", "DimSize = 4 3 6", &["wrong.mha", "promises 72 voxels"]),
        ("DimSize = 4 3 5", "DimSize = 4294967295 4294967295 4294967295", &["'DimSize'", "more than"]),
        ("MET_SHORT", "MET_LONG_LONG", &["'ElementType'", "MET_LONG_LONG", "MET_UCHAR"]),
        ("NDims = 3", "NDims = 3\nElementNumberOfChannels = 3", &["'ElementNumberOfChannels'"]),
        ("NDims = 3", "NDims = 3\nBinaryData = False", &["'BinaryData'", "text"]),
        ("NDims = 3", "NDims = 3\nCompressedData = perhaps", &["'CompressedData'", "perhaps"]),
        ("ElementSpacing = 1 1 1", "ElementSpacing = 1 0 1", &["'ElementSpacing'", "not positive"]),
        ("ElementSpacing = 1 1 1", "ElementSpacing = 1 nan 1", &["'ElementSpacing'", "not positive"]),
        ("1 0 0 0 1 0 0 0 1", "1 0 0 1 0 0 0 0 1", &["'TransformMatrix'", "singular"]),
        ("1 0 0 0 1 0 0 0 1", "1 0 0 0 0 0 0 0 1", &["'TransformMatrix'", "length 0"]),
        ("TransformMatrix = 1 0 0 0 1 0 0 0 1", "AnatomicalOrientation = RLS", &["'AnatomicalOrientation'", "RLS"]),
        ("Offset = 0 0 0", "Offset = 0 inf 0", &["'Offset'", "not finite"]),
        ("HeaderSize = 0", "HeaderSize = 1", &["'HeaderSize'", "1 is not possible"]),
        ("HeaderSize = 0", "HeaderSize = -7", &["'HeaderSize'", "-7"]),
        ("HeaderSize = 0", "HeaderSize = 999999", &["wrong.mha", "start at byte 999999"]),
        ("HeaderSize = 0", "CompressedData = True\nHeaderSize = -1", &["'HeaderSize'"]),
        ("ElementDataFile = LOCAL\n", "", &["'ElementDataFile'"]),
        ("= LOCAL", "= LIST", &["'ElementDataFile'", "several files"]),
        ("= LOCAL", "= wrong%03d.raw 1 3 1", &["'ElementDataFile'", "several files"]),
        ("= LOCAL", "= wrong.absent", &["wrong.absent", "cannot open"]),
    ];
    for (from, to, parts) in cases {
        assert!(META.contains(from), "{from}");
        let data: &[u8] = if to.is_empty() { b"" } else { &[0; 120] };
        write(path.clone(), &[META.replace(from, to).as_bytes(), data]);
        assert_parts(&error_of(&path, None), parts);
    }
    write(path.clone(), &[META.as_bytes(), &[0; 120]]);
    volume::load(&path, None).unwrap();
}

#[test]
fn wrong_nifti_headers_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let image = Image::asymmetric(DMat3::IDENTITY);
    for version in [1u8, 2] {
        for big in [false, true] {
            let form = Nifti { version, big, ..PLAIN_NIFTI };
            let qform = Nifti { qform: true, ..form };
            let put = |form: Nifti, change: &dyn Fn(&mut NiftiBytes)| {
                let mut h = NiftiBytes { bytes: nifti_header(&image, ScalarType::I16, form), form };
                change(&mut h);
                let data = [0; 20 + 120];
                error_of(&write(dir.path().join("wrong.nii"), &[&h.bytes, &data]), None)
            };
            assert_parts(&put(form, &|h| h.bytes[0] = 9), &["'sizeof_hdr'", "348", "540"]);
            assert_parts(&put(form, &|h| h.dim(0, 8)), &["'dim'", "8 dimensions"]);
            assert_parts(&put(form, &|h| h.dim(2, 0)), &["'dim'", "zero"]);
            assert_parts(&put(form, &|h| h.dim(2, -3)), &["'dim'", "-3 is negative"]);
            assert_parts(&put(form, &|h| h.dim(3, 6)), &["wrong.nii", "promises 72 voxels"]);
            let series = |h: &mut NiftiBytes| {
                h.dim(0, 4);
                h.dim(4, 20);
            };
            assert_parts(&put(form, &series), &["'dim'", "series of 20", "fslroi"]);
            let vectors = |h: &mut NiftiBytes| {
                h.dim(0, 5);
                h.dim(5, 3);
            };
            assert_parts(&put(form, &vectors), &["'dim'", "3 numbers per voxel"]);
            assert_parts(&put(form, &|h| h.short([70, 12], 128)), &["'datatype'", "128", "512 (u16)"]);
            let slope = |h: &mut NiftiBytes| h.real([112, 176], 0, f64::INFINITY);
            assert_parts(&put(form, &slope), &["'scl_slope'", "not finite"]);
            let intercept = |h: &mut NiftiBytes| {
                h.real([112, 176], 0, 1.0);
                h.real([112, 176], 1, f64::NAN);
            };
            assert_parts(&put(form, &intercept), &["'scl_slope'", "not finite"]);
            assert_parts(&put(form, &|h| h.real([280, 400], 0, 0.0)), &["'srow_x'", "step 0 has length 0"]);
            assert_parts(&put(form, &|h| h.real([280, 400], 5, f64::NAN)), &["'srow_x'", "NaN"]);
            assert_parts(&put(form, &|h| h.real([280, 400], 3, f64::NAN)), &["'srow_x'", "origin"]);
            let singular = |h: &mut NiftiBytes| {
                h.real([280, 400], 0, 0.0);
                h.real([280, 400], 4, 1.0);
            };
            assert_parts(&put(form, &singular), &["'srow_x'", "singular"]);
            assert_parts(&put(qform, &|h| h.real([76, 104], 2, 0.0)), &["'pixdim'", "not positive"]);
            assert_parts(&put(qform, &|h| h.real([76, 104], 2, -1.0)), &["'pixdim'", "not positive"]);
            assert_parts(&put(qform, &|h| h.real([76, 104], 2, f64::NAN)), &["'pixdim'", "not positive"]);
            assert_parts(&put(qform, &|h| h.real([256, 352], 1, f64::NAN)), &["'quatern_b'", "not finite"]);
            assert_parts(&put(qform, &|h| h.real([256, 352], 4, f64::NAN)), &["'qoffset_x'", "origin"]);
            let offset = |value: f64| {
                move |h: &mut NiftiBytes| match h.form.version {
                    1 => h.raw(108, (value as f32).to_le_bytes().to_vec()),
                    _ => h.raw(168, (value as i64).to_le_bytes().to_vec()),
                }
            };
            assert_parts(&put(form, &offset(-8.0)), &["'vox_offset'", "-8"]);
            assert_parts(&put(form, &offset(100.0)), &["'vox_offset'", "within the header"]);
            assert_parts(&put(form, &offset(1e18)), &["'vox_offset'", "not a file offset"]);
            assert_parts(&put(form, &offset(1e12)), &["wrong.nii", "start at byte"]);
            let analyze = |h: &mut NiftiBytes| {
                let at = if h.form.version == 1 { 344 } else { 4 };
                h.bytes[at..at + 4].fill(0);
            };
            assert_parts(&put(form, &analyze), &["'magic'", "Analyze"]);
        }
    }
    let path = write(dir.path().join("short.nii"), &[&nifti_header(&image, ScalarType::I16, PLAIN_NIFTI)[..200]]);
    assert_parts(&error_of(&path, None), &["after 200 of 348 bytes"]);
    let lonely = Nifti { pair: true, ..PLAIN_NIFTI };
    let path = write(dir.path().join("lonely.hdr"), &[&nifti_header(&image, ScalarType::I16, lonely)]);
    assert_parts(&error_of(&path, None), &["lonely.img", "cannot open"]);
}

#[test]
fn wrong_raw_files_and_names_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path().join("wrong.raw"), &[&[0; 60]]);
    let good = RawLayout {
        dims: [4, 3, 5],
        scalar: ScalarType::U8,
        big_endian: false,
        spacing: [1.0; 3],
        origin: [0.0; 3],
        skip: 0,
    };
    volume::load(&path, Some(&good)).unwrap();
    let cases: [(RawLayout, &[&str]); 8] = [
        (RawLayout { dims: [4, 3, 6], ..good }, &["promises 72 voxels of u8", "only 60 bytes"]),
        (RawLayout { dims: [4, 0, 5], ..good }, &["raw size", "zero"]),
        (RawLayout { dims: [u32::MAX; 3], ..good }, &["raw size", "more than"]),
        (RawLayout { scalar: ScalarType::F64, ..good }, &["60 voxels of f64", "480 bytes"]),
        (RawLayout { skip: 1, ..good }, &["only 59 bytes"]),
        (RawLayout { skip: u64::MAX, ..good }, &["start at byte 18446744073709551615"]),
        (RawLayout { spacing: [1.0, f64::NAN, 1.0], ..good }, &["raw spacing", "not positive"]),
        (RawLayout { origin: [0.0, f64::INFINITY, 0.0], ..good }, &["raw origin", "not finite"]),
    ];
    for (layout, parts) in cases {
        assert_parts(&error_of(&path, Some(&layout)), parts);
    }
    assert_parts(&error_of(&path, None), &["no reader knows", ".nii.gz", "raw file state its size"]);
    assert_parts(&error_of(dir.path(), None), &["directory", "DICOM", "dcm2niix"]);
    assert_parts(&error_of(&dir.path().join("absent.nrrd"), None), &["cannot open"]);
    let nrrd = write(dir.path().join("v.nrrd"), &[NRRD.as_bytes(), b"\n", &[0; 120]]);
    assert_parts(&error_of(&nrrd, Some(&good)), &["raw layout", "header"]);
}

#[test]
fn damaged_and_truncated_data_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let image = Image::asymmetric(DMat3::from_euler(EulerRot::ZYX, 0.4, -0.7, 1.1));
    for (name, writer) in writers() {
        let path = writer(&image, dir.path(), ScalarType::I16);
        // The file with the voxels.
        let data = match path.extension().unwrap().to_str().unwrap() {
            "nhdr" => dir.path().join("sub/data.bin"),
            "mhd" => dir.path().join("data.bin"),
            "hdr" => dir.path().join("pair.img"),
            _ => path.clone(),
        };
        let whole = fs::read(&data).unwrap();
        fs::write(&data, &whole[..whole.len() - 20]).unwrap();
        let text = volume::load(&path, None).map(|v| v.grid).expect_err(&name).to_string();
        assert!(text.contains("truncated"), "{name}: {text}");
        assert!(text.contains(data.file_name().unwrap().to_str().unwrap()), "{name}: {text}");

        if name.contains("zlib: true") || name.contains("gzip: true") {
            let mut damaged = whole.clone();
            let at = damaged.len() - 3; // within the checksum
            damaged[at] ^= 0x10;
            // Gzip ends with the checksum (4 bytes) and the length (4 bytes), zlib with the checksum.
            fs::write(&data, damaged).unwrap();
            let text = volume::load(&path, None).map(|v| v.grid).expect_err(&name).to_string();
            assert_parts(&text, &["damaged", data.file_name().unwrap().to_str().unwrap()]);
        }
    }
}

/// Peak virtual memory of this process in bytes; `None` where the system does not tell.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmPeak:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kib| 1024 * kib)
}

/// Far below what the headers promise, far above what the tests that run beside this one need.
const MEMORY_BOUND: u64 = 2 << 30;

#[test]
fn headers_that_promise_gigabytes_reserve_no_memory() {
    let dir = tempfile::tempdir().unwrap();
    let before = peak_memory();
    let mut absurd = Image::asymmetric(DMat3::IDENTITY);
    absurd.dims = [1290, 1290, 1290]; // 17 GB of f64
    for (name, writer) in writers() {
        let path = writer(&absurd, dir.path(), ScalarType::F64);
        let text = volume::load(&path, None).map(|v| v.grid).expect_err(&name).to_string();
        assert!(text.contains("17173512000 bytes"), "{name}: {text}");
    }
    // A bomb: 64 MiB of zeros in 64 KiB, where 60 voxels are expected and where just too many are.
    let zeros = gzip(&vec![0; 64 << 20]);
    let header = NRRD.replace("raw", "gzip");
    let path = write(dir.path().join("bomb.nrrd"), &[header.as_bytes(), b"\n", &zeros]);
    assert_eq!(volume::load(&path, None).unwrap().data, VoxelData::I16(vec![0; 60]));
    let header = header.replace("4 3 5", "33554433 1 1");
    let path = write(dir.path().join("bomb.nrrd"), &[header.as_bytes(), b"\n", &zeros]);
    assert_parts(&error_of(&path, None), &["data end after 67108864 of 67108866 bytes"]);
    if let (Some(before), Some(after)) = (before, peak_memory()) {
        assert!(after - before < MEMORY_BOUND, "peak memory grew by {} bytes", after - before);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is cut off or flipped, in the header or in the data: a volume of the promised size or an error.
    #[test]
    fn damaged_files_never_panic(
        which in 0usize..1000,
        cut in prop::option::weighted(0.3, 0.0f64..1.0),
        flips in prop::collection::vec((0.0f64..1.0, 0u8..8), 0..4),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let image = Image::asymmetric(DMat3::from_euler(EulerRot::ZYX, 0.4, -0.7, 1.1));
        let writers = writers();
        let (_, writer) = &writers[which % writers.len()];
        let path = writer(&image, dir.path(), ScalarType::U16);
        let mut bytes = fs::read(&path).unwrap();
        for (at, bit) in flips {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] ^= 1 << bit;
        }
        if let Some(cut) = cut {
            bytes.truncate((cut * bytes.len() as f64) as usize);
        }
        fs::write(&path, bytes).unwrap();
        let before = peak_memory();
        match volume::load(&path, None) {
            Ok(loaded) => prop_assert_eq!(loaded.data.len() as u64, loaded.grid.voxels()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
        if let (Some(before), Some(after)) = (before, peak_memory()) {
            prop_assert!(after - before < MEMORY_BOUND, "peak memory grew by {} bytes", after - before);
        }
    }
}
