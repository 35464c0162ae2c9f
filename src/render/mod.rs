//! Renders a scene: makes the passes, records every iteration, and keeps the device busy with bounded submissions.

pub mod auto;
mod memory;
pub mod path;
pub mod state;

use self::auto::Costs;
use crate::abi::PilotSample;
use crate::output::Picture;
use crate::passes::camera::{Camera, Content};
use crate::passes::classify::{Classify, Emitted};
use crate::passes::compact::{Blocks, Chunk, ChunkArgs, List, Listed, Marks};
use crate::passes::emptiness::Emptiness;
use crate::passes::gather::{Gather, GatherArgs, GatherConfig, Gathered};
use crate::passes::mips::Mips;
use crate::passes::phong::Phong;
use crate::passes::pilot::{Look, Pilot};
use crate::passes::project::{Kept, Projection, Scattering, Source};
use crate::passes::proxy::{Proxy, ProxyConfig};
use crate::passes::scene_data::SceneData;
use crate::passes::see::{self, See};
use crate::passes::share_of;
use crate::passes::single_scatter::SingleScatter;
use crate::scene::{self, LightFor, Mask, Model, Precision, Sampling, Scene, Settings};
use crate::shaders::constants;
use crate::stats::{AutoStats, PassStats, ProxyStats, Stats, VolumeStats, pass_stats};
use crate::vk::{Access, Buffer, Context, Image, ImageFormat, ImageReadBack, Recorder, Submission, TimedPass};
use crate::{Error, Result};
use std::collections::VecDeque;
use std::ops::{ControlFlow, Range, RangeInclusive};
use std::time::Instant;

/// How far a render is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Done share of the work, 0 to 1.
    pub done: f64,
    /// What is being done.
    pub phase: &'static str,
}

fn stopped() -> Error {
    Error::Stopped { cure: "start it again" }
}

/// Knobs that only tests turn.
#[derive(Clone, Copy, Debug, Default)]
pub struct Internals {
    /// Sets every bucketColor to zero after each build of the proxy.
    pub zero_bucket_colors: bool,
    /// Runs that the proxy's lists hold.
    pub proxy_capacity: Option<u32>,
    /// Voxels of a segment of the active list.
    pub segment_voxels: Option<u32>,
    /// What `auto` decides by, instead of the device's own costs.
    pub costs: Option<Costs>,
    /// Gathers in cells out of the eye's reach too.
    pub gathers_everywhere: bool,
    /// Stores three channels of light where one would do.
    pub stores_color: bool,
}

/// Renders `scene`. `progress` is called now and then; `Break` stops the render.
///
/// Errors: the device cannot hold the scene, a pass reports a failure, or the render was stopped.
pub fn render(
    ctx: &Context,
    scene: &Scene,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<(Picture, Stats)> {
    if scene.settings.model == Model::Path {
        return path::render(ctx, scene, None, progress);
    }
    let start = Instant::now();
    let mut renderer = Renderer::new(ctx, scene, Internals::default())?;
    let picture = renderer.render(scene.settings.seed, progress)?;
    let stats = renderer.stats(scene, start.elapsed().as_secs_f64() * 1e3)?;
    Ok((picture, stats))
}

/// A scene set up on a device: renders any number of seeds and views without making anything anew.
pub struct Renderer<'a> {
    ctx: &'a Context,
    orders: u32,
    /// Of their directions, what gathers use whose light the eye sees only after another one.
    inner_share: f32,
    /// The same where `auto` decided on `residual`.
    decided_inner_share: f32,
    /// Environment directions of a cell where single scattering samples what the eye sees.
    environment_directions: u32,
    samples: u32,
    mask: Mask,
    data: SceneData,
    classify: Classify,
    phong: Option<Phong>,
    camera: Camera,
    scatter: Option<Scatter>,
    marks: Marks,
    /// Where some cells get fewer directions.
    see: Option<See>,
    /// The eyes that cells are hidden from; none: from that of the picture.
    views: Vec<scene::Camera>,
    eye: scene::Camera,
    gathers_everywhere: bool,
    /// Does `see` miss no cell that rays of its eyes reach?
    is_dense: bool,
    /// Does what is stored depend on the eye?
    is_for_eye: bool,
    /// Is everything there that the camera reads?
    is_lit: bool,
    /// What the voxel passes work on: voxels for `phong`, cells for scattering.
    lists: Vec<Shared>,
    active: u64,
    emptiness: Emptiness,
    /// The emitted source; one texel where nothing that emits is scattered.
    emitted: Image,
    /// What the camera reads.
    total: Source,
    picture: Image,
    proxy_log: Buffer<u32>,
    /// Of the latest light, with the sampling `auto`.
    decision: Option<AutoStats>,
    times: Vec<TimedPass>,
}

/// A picture that is being taken.
#[must_use = "dropping it waits for it"]
pub struct Taken {
    submissions: Vec<Submission>,
    pixels: ImageReadBack<[f32; 4]>,
    size: [u32; 2],
    times: Vec<TimedPass>,
}

impl Taken {
    /// Waits for the picture; returns the times of its passes too.
    pub fn finish(mut self) -> Result<(Picture, Vec<TimedPass>)> {
        for submission in self.submissions {
            self.times.extend(submission.wait()?);
        }
        let [width, height] = self.size;
        Ok((Picture { width, height, pixels: self.pixels.wait()? }, self.times))
    }
}

/// What the items of a list get of the directions.
#[derive(Clone, Copy)]
struct Share {
    of_all: f32,
    /// Out of the eye's reach: nothing is gathered there for the eye alone.
    is_remote: bool,
}

impl Share {
    const ALL: Self = Self { of_all: 1.0, is_remote: false };
}

/// A list whose items get the given share.
struct Shared {
    list: List,
    share: Share,
}

/// The cells of one [`Shared`] list, with arguments for the dispatches over them.
struct Cells<'a> {
    list: &'a List,
    share: Share,
    args: ChunkArgs,
    /// Of the inner gathers, and of the last.
    gather: Option<[GatherArgs; 2]>,
    emission: Option<GatherArgs>,
    lights: Option<[GatherArgs; 2]>,
}

/// What scattering needs; the local models do without.
struct Scatter {
    single: SingleScatter,
    /// The gather of scattered light; with `auto` that by `phase`.
    gather: Option<Gather>,
    auto: Option<Auto>,
    /// The gather of emitted light, and its classification.
    emission: Option<(Gather, Classify)>,
    /// The proxy, and the means over voxels that it is made of: values at voxel centres miss what lies between them.
    proxy: Option<(Proxy, Mips)>,
    /// The voxels that it encodes, where these are not the nodes.
    encoded: Option<(Marks, List)>,
    projection: Projection,
    /// The voxels that it writes.
    nodes: List,
    /// Of all orders so far.
    source: Source,
    /// Of the part of it that every iteration adds anew: light by single scattering that no gather brings. Where there is
    /// such light, and a further order.
    fixed: Option<Source>,
    /// For g ≠ 0: the gather of order 1 of delta lights, and that order of the first lights; the others go by moments.
    lights: Option<(Gather, Vec<Image>)>,
}

/// What the sampling `auto` decides by.
struct Auto {
    pilot: Pilot,
    costs: Costs,
    wanted: GatherConfig,
    /// Cells of a chunk, for the gather that may be decided on.
    chunk: u32,
}

/// Delta lights whose order 1 is kept apart where g ≠ 0: each takes an image, and a gather of its own.
const MOST_SEPARATE_LIGHTS: u32 = 4;

/// List items of a chunk: a dispatch should stay below 100 ms, and a chunk's lists below the bytes given here. A large device
/// needs large dispatches: with chunks of a quarter of the usual size all passes took 1.4 times as long on an H100.
pub(crate) fn chunk_items(ctx: &Context, gather: Option<&GatherConfig>) -> u32 {
    let usual = if ctx.is_cpu() { 1 << 15 } else { 1 << 18 };
    gather.map_or(usual, |g| usual.min(g.max_chunk(chunk_bytes(ctx))).max(64))
}

/// Of so many rays along both axes the rows of one dispatch after the other, each with about as many rays as a chunk of voxels has.
pub(crate) fn bands(ctx: &Context, [width, height]: [u32; 2]) -> impl Iterator<Item = Range<u32>> {
    let most = if ctx.is_cpu() { 1 << 17 } else { 1 << 21 };
    let band = (most / width).clamp(1, height);
    (0..height).step_by(band as usize).map(move |begin| begin..height.min(begin + band))
}

/// Bytes of a list that a chunk's cells may have.
fn chunk_bytes(ctx: &Context) -> u64 {
    ctx.max_storage_bytes().min(if ctx.is_cpu() { 64 << 20 } else { 256 << 20 })
}

/// Of the directions, what inner gathers use. Fewer than a cell has points would be noisier by far than they are cheaper: even what is the
/// same everywhere would come out uneven. The lower level of `residual` reaches all points anyway.
fn inner_share(settings: &Settings, sampling: Sampling) -> f32 {
    if sampling == Sampling::Residual {
        return settings.inner_share;
    }
    // Rounded up to one for each point, whatever the division makes of it.
    let least = (constants::CELL_POINTS as f32 - 0.5) / settings.directions as f32;
    settings.inner_share.max(least).min(1.0)
}

/// Random-number streams: orders count from 1; the gathers of emitted light and of single lights have their own.
const EMISSION_STREAM: u32 = 0x454D_4954;
const LIGHT_STREAM: u32 = 0x4C49_4700;

impl<'a> Renderer<'a> {
    /// Uploads the scene and makes the passes that its settings use.
    ///
    /// Errors: the device lacks something; of memory, the error says what would fit.
    pub fn new(ctx: &'a Context, scene: &Scene, internals: Internals) -> Result<Self> {
        Self::build(ctx, scene, internals).map_err(|error| memory::advise(ctx, scene, error))
    }

    fn build(ctx: &'a Context, scene: &Scene, internals: Internals) -> Result<Self> {
        let s = &scene.settings;
        if s.precision == Precision::Single && !ctx.stores_fields(ImageFormat::Rgba32Float) {
            let problem = "the device does not interpolate images of 32-bit floats";
            return Err(Error::input("--precision", problem, "use half"));
        }
        let data = SceneData::with_color(ctx, scene, internals.stores_color)?;
        let dims = data.params.dims;
        let orders = match s.model {
            Model::Single => 1,
            Model::Multiple => s.orders,
            Model::Absorption | Model::Phong => 0,
            Model::Path => unreachable!("PathRender renders it"),
        };
        let gather_config = GatherConfig::of(s);
        let is_auto = s.sampling == Sampling::Auto;
        let chunk = chunk_items(ctx, (orders > 1).then_some(&gather_config));
        let segment = internals.segment_voxels;
        let emits = orders > 0 && data.has_emission;
        // What the camera sees of delta lights by single scattering is stored nowhere.
        let stores_light = orders > 1 || orders == 1 && (emits || data.environment != constants::ENVIRONMENT_NONE);
        let is_for_any = s.light_for == LightFor::EveryView;
        let views = if is_for_any { scene.views.clone() } else { Vec::new() };
        let is_shared = stores_light && s.hidden_share < 1.0 && !(is_for_any && views.is_empty());
        let is_directed = stores_light && data.params.g != 0.0 && is_for_any;
        let has_moments = stores_light && data.params.g != 0.0 && (orders > 1 || is_for_any);
        let listed = match s.model {
            Model::Phong => &[(Listed::Voxels, 1.0)][..],
            _ if is_shared => &[
                (Listed::SeenCells, 1.0),
                (Listed::HiddenCells, s.hidden_share),
                (Listed::RemoteCells, s.hidden_share),
            ],
            _ if stores_light => &[(Listed::Cells, 1.0)],
            _ => &[],
        };
        let blocks = data.light_blocks();
        let shared = |&(listed, of_all)| {
            let share = Share { of_all, is_remote: listed == Listed::RemoteCells };
            Ok(Shared { list: List::new(ctx, blocks, listed, chunk, segment)?, share })
        };
        let lists = listed.iter().map(shared).collect::<Result<_>>()?;
        let scatter = if stores_light {
            let has_next = orders > 1;
            let with_proxy = has_next && s.sampling.uses_proxy();
            let separate =
                if has_next && data.params.g != 0.0 { data.light_count.min(MOST_SEPARATE_LIGHTS) } else { 0 };
            let is_sampled = data.environment == constants::ENVIRONMENT_IMAGE;
            let has_fixed = has_next && (data.light_count > separate || is_sampled || emits);
            Some(Scatter {
                lights: if separate > 0 {
                    let image = |_| data.field(ctx, "light", dims);
                    let gather = Gather::new(ctx, &data, gather_config, chunk, Gathered::Light)?;
                    Some((gather, (0..separate).map(image).collect::<Result<_>>()?))
                } else {
                    None
                },
                single: SingleScatter::new(ctx, &data, s.gather_step)?,
                gather: if has_next {
                    Some(Gather::new(ctx, &data, gather_config, chunk, Gathered::Projected)?)
                } else {
                    None
                },
                auto: if has_next && is_auto {
                    let steps = [gather_config.step, gather_config.proxy_step];
                    let pilot = Pilot::new(ctx, &data, gather_config.directions, steps)?;
                    let costs = internals.costs.map_or_else(|| Costs::of(ctx), Ok)?;
                    Some(Auto { pilot, costs, wanted: gather_config, chunk })
                } else {
                    None
                },
                emission: if emits {
                    let gather = Gather::new(ctx, &data, gather_config, chunk, Gathered::Emitted)?;
                    Some((gather, Classify::new(ctx, &data, Emitted::Emission)?))
                } else {
                    None
                },
                proxy: if with_proxy {
                    let config = ProxyConfig {
                        capacity: internals.proxy_capacity,
                        zero_colors: internals.zero_bucket_colors,
                        ..ProxyConfig::of(s.mask)
                    };
                    Some((Proxy::new(ctx, &data, config)?, Mips::means_of_voxels(ctx, dims)?))
                } else {
                    None
                },
                encoded: if with_proxy && blocks.edge > 1 {
                    let voxels = Blocks::of(dims, 1);
                    Some((Marks::new(ctx, voxels)?, List::new(ctx, voxels, Listed::Nodes, chunk, segment)?))
                } else {
                    None
                },
                projection: Projection::new(ctx, &data, chunk, s.projection_steps, has_next, s.light_for)?,
                nodes: List::new(ctx, blocks, Listed::Nodes, chunk, segment)?,
                source: Source::new(ctx, &data, "source", has_moments)?,
                fixed: if has_fixed { Some(Source::new(ctx, &data, "fixed", data.params.g != 0.0)?) } else { None },
            })
        } else {
            None
        };
        let content = match orders {
            0 => Content::Local,
            _ if is_directed => Content::Directed,
            _ => Content::Scattering,
        };
        let has_eye = scatter.as_ref().is_some_and(|s| s.projection.has_eye());
        let emitted = if s.model == Model::Absorption { Emitted::Color } else { Emitted::Nothing };
        Ok(Self {
            ctx,
            orders,
            inner_share: inner_share(s, s.sampling),
            decided_inner_share: inner_share(s, Sampling::Residual),
            environment_directions: s.environment_directions,
            samples: s.spp,
            mask: s.mask,
            classify: if orders > 0 {
                Classify::with_extinction(ctx, &data, emitted)?
            } else {
                Classify::new(ctx, &data, emitted)?
            },
            phong: if s.model == Model::Phong { Some(Phong::new(ctx, &data)?) } else { None },
            camera: Camera::new(ctx, &data, scene.background, [s.camera_step, s.gather_step], s.spp, content)?,
            scatter,
            marks: Marks::new(ctx, blocks)?,
            see: if is_shared { Some(See::new(ctx)?) } else { None },
            is_for_eye: s.model == Model::Phong || has_eye || is_shared && views.is_empty(),
            views,
            eye: scene.camera,
            gathers_everywhere: internals.gathers_everywhere,
            is_dense: false,
            is_lit: false,
            lists,
            active: 0,
            emptiness: Emptiness::for_rays(ctx, dims)?,
            emitted: data.field(ctx, "emitted", if emits { dims } else { [1; 3] })?,
            total: Source::new(ctx, &data, "total", is_directed)?,
            picture: Camera::picture(ctx, s.size)?,
            proxy_log: ctx.device_buffer("proxy.log", (constants::PROXY_WORDS * orders.max(1)) as usize)?,
            data,
            decision: None,
            times: Vec::new(),
        })
    }

    /// Renders with the given seed; all light is computed anew.
    pub fn render(&mut self, seed: u64, progress: &mut dyn FnMut(Progress) -> ControlFlow<()>) -> Result<Picture> {
        self.data.set_seed(self.ctx, seed)?;
        self.is_lit = false;
        self.picture(progress)
    }

    /// Moves the eye for the next [`Self::picture`].
    pub fn look(&mut self, eye: &scene::Camera) -> Result<()> {
        self.data.set_camera(self.ctx, eye)?;
        self.is_lit &= !self.is_for_eye || self.eye == *eye;
        self.is_lit &= !self.is_dense || self.is_expected(&self.eye) == self.is_expected(eye);
        self.eye = *eye;
        Ok(())
    }

    /// Does `see` look through this eye?
    fn is_expected(&self, eye: &scene::Camera) -> bool {
        self.views.is_empty() || self.views.contains(eye)
    }

    /// Takes a picture. Light is computed only if what is there already, of this seed, is not for this eye.
    pub fn picture(&mut self, progress: &mut dyn FnMut(Progress) -> ControlFlow<()>) -> Result<Picture> {
        let (picture, times) = self.begin_picture(progress)?.finish()?;
        self.times = times;
        Ok(picture)
    }

    /// Does the same, but leaves the last of the work to the device: what the host does next, it does meanwhile.
    pub fn begin_picture(&mut self, progress: &mut dyn FnMut(Progress) -> ControlFlow<()>) -> Result<Taken> {
        let mut queue = Queue::new(progress);
        if self.is_lit {
            queue.total = self.camera_work();
        } else {
            self.light(&mut queue)?;
            if let Some(proxy) = self.proxy() {
                proxy.check(self.ctx)?;
            }
            self.is_lit = true;
        }
        self.take_picture(&mut queue)?;
        Ok(Taken {
            submissions: queue.in_flight.into_iter().map(|work| work.0).collect(),
            pixels: self.ctx.begin_read_back_image(&self.picture)?,
            size: self.data.params.size,
            times: queue.times,
        })
    }

    /// Everything before the camera.
    fn light(&mut self, queue: &mut Queue<'_>) -> Result<()> {
        self.set_up(queue)?;
        queue.total = self.light_work() + self.camera_work();
        if let Some(phong) = &self.phong {
            let list = &self.lists[0].list;
            let mut rec = Recorder::new(self.ctx)?;
            let args = list.chunk_args(self.ctx, &mut rec, 1)?;
            rec.begin_pass("phong", 0);
            for chunk in list.chunks() {
                phong.record(&mut rec, &self.data, &chunk, &args, &self.total.a);
            }
            rec.end_pass();
            queue.submit(rec, 0.0, "shading")?;
        }
        if let Some(scatter) = &self.scatter {
            self.decision = self.scatter(scatter, queue)?;
        }
        Ok(())
    }

    /// Classification, empty-space structure, lists.
    fn set_up(&mut self, queue: &mut Queue<'_>) -> Result<()> {
        let mut rec = Recorder::new(self.ctx)?;
        if let Some(scatter) = &self.scatter {
            scatter.source.clear(&mut rec);
            if let Some(fixed) = &scatter.fixed {
                fixed.clear(&mut rec);
            }
            for image in scatter.lights.iter().flat_map(|(_, images)| images) {
                rec.clear_image(image);
            }
            scatter.projection.record_clear_all(&mut rec);
            for b in &self.total.b {
                rec.clear_image(b);
            }
            rec.barrier(Access::TransferWrite, Access::ComputeReadWrite);
        }
        rec.begin_pass("classify", 0);
        self.classify.record(&mut rec, &self.data, &self.total.a);
        if let Some((_, classify)) = self.scatter.as_ref().and_then(|s| s.emission.as_ref()) {
            classify.record(&mut rec, &self.data, &self.emitted);
        }
        self.emptiness.record(&mut rec, &self.data, &self.total.a);
        rec.end_pass();
        rec.begin_pass("compact", 0);
        self.marks.record(&mut rec, &self.data, &self.total.a, &self.emptiness);
        if let Some((marks, list)) = self.scatter.as_ref().and_then(|s| s.encoded.as_ref()) {
            marks.record(&mut rec, &self.data, &self.total.a, &self.emptiness);
            list.record(&mut rec, &self.data, marks);
        }
        rec.end_pass();
        if let Some(see) = &self.see {
            queue.submit(rec, 0.0, "classifying")?;
            let size = self.data.params.size;
            let eyes = if self.views.is_empty() { std::slice::from_ref(&self.eye) } else { &self.views };
            self.is_dense = !self.gathers_everywhere;
            for eye in eyes {
                self.data.set_camera(self.ctx, eye)?;
                let rays = see::rays(&self.data.params);
                self.is_dense &= rays.is_dense;
                for rows in bands(self.ctx, size.map(|n| n * rays.per_pixel)) {
                    let mut rec = Recorder::new(self.ctx)?;
                    rec.begin_pass("see", 0);
                    see.record(&mut rec, &self.data, self.extinction(), &self.emptiness.image, &self.marks, rows);
                    rec.end_pass();
                    queue.submit(rec, 0.0, "classifying")?;
                }
            }
            self.data.set_camera(self.ctx, &self.eye)?;
            rec = Recorder::new(self.ctx)?;
        }
        rec.begin_pass("compact", 0);
        for list in self.lists.iter().map(|s| &s.list).chain(self.scatter.as_ref().map(|s| &s.nodes)) {
            list.record(&mut rec, &self.data, &self.marks);
        }
        rec.end_pass();
        queue.submit(rec, 0.0, "classifying")?;
        self.active = self.marks.active_voxels(self.ctx)?;
        for list in self.lists.iter_mut().map(|s| &mut s.list) {
            list.read_counts(self.ctx)?;
        }
        if let Some(scatter) = &mut self.scatter {
            for list in [&mut scatter.nodes].into_iter().chain(scatter.encoded.as_mut().map(|(_, list)| list)) {
                list.read_counts(self.ctx)?;
            }
        }
        Ok(())
    }

    /// What the inner gathers give to cells of the given share, and what the last one does: the inner ones, whose light the eye sees
    /// only after another, a part; the last one nothing to those out of the eye's reach.
    fn shares(&self, share: Share) -> [f32; 2] {
        let is_unseen = share.is_remote && self.is_dense && self.is_expected(&self.eye);
        [self.inner_share * share.of_all, if is_unseen { 0.0 } else { share.of_all }]
    }

    /// The same for light of order 1, which may be the last.
    fn first_share(&self, share: Share) -> f32 {
        if self.orders > 1 { share.of_all } else { self.shares(share)[1] }
    }

    /// Environment directions of a cell that gets the given share of them, for what the eye sees. A constant environment is
    /// brought by the last gather where there is one.
    fn environment_rays(&self, share: Share) -> u32 {
        match self.data.environment {
            constants::ENVIRONMENT_NONE => 0,
            constants::ENVIRONMENT_CONSTANT if self.orders > 1 => 0,
            _ => share_of(self.environment_directions, self.first_share(share)),
        }
    }

    /// The same for order 1 of an environment that the gathers bring: the first of them needs it as light to scatter.
    fn inner_environment_rays(&self, scatter: &Scatter, share: Share) -> u32 {
        match &scatter.gather {
            Some(gather) if self.data.environment == constants::ENVIRONMENT_CONSTANT => {
                gather.directions(self.shares(share)[0])
            }
            _ => 0,
        }
    }

    /// Rough cost of the light in traced rays, for the progress bar.
    fn light_work(&self) -> f64 {
        let rays = |s: &Scatter, share: Share| {
            let emission = s.emission.as_ref().map_or(0.0, |e| e.0.rays(self.first_share(share)));
            let first = f64::from(self.environment_rays(share)) + emission;
            let lights = if s.gather.is_some() { f64::from(s.single.light_rays(&self.data)) } else { 0.0 };
            let inner = f64::from(self.orders.saturating_sub(2));
            let [of_inner, of_last] = self.shares(share);
            let gathers = |g: &Gather| inner * g.rays(of_inner) + g.rays(of_last);
            let later = s.gather.as_ref().map_or(0.0, gathers);
            let separate = s.lights.as_ref().map_or(0.0, |(g, images)| gathers(g) * images.len() as f64);
            first + f64::from(self.inner_environment_rays(s, share)) + lights + later + separate
        };
        let of_list = |s: &Scatter| self.lists.iter().map(|l| l.list.items() as f64 * rays(s, l.share)).sum();
        self.scatter.as_ref().map_or(0.0, of_list)
    }

    /// The camera's, in the same unit.
    fn camera_work(&self) -> f64 {
        self.row_work() * f64::from(self.data.params.size[1] * self.samples)
    }

    /// Of one sample of a row of pixels.
    fn row_work(&self) -> f64 {
        2.0 * f64::from(self.data.params.size[0])
    }

    /// Light of all orders. With K the gather and D, what single scattering brings, the orders up to n are
    /// sₙ = D + K sₙ₋₁. So only the last gather needs many directions: the noise of those before is averaged by it.
    ///
    /// Returns what `auto` decided on, if it was asked.
    fn scatter(&self, scatter: &Scatter, queue: &mut Queue<'_>) -> Result<Option<AutoStats>> {
        let (ctx, data) = (self.ctx, &self.data);
        let mut rec = Recorder::new(ctx)?;
        let node_args = scatter.nodes.chunk_args(ctx, &mut rec, 1)?;
        let encoded = scatter.encoded.as_ref().map(|(_, list)| list);
        let encoded_args = encoded.map(|list| list.chunk_args(ctx, &mut rec, 1)).transpose()?;
        let (encoded, encoded_args) = (encoded.unwrap_or(&scatter.nodes), encoded_args.as_ref().unwrap_or(&node_args));
        let mut groups = Vec::new();
        for &Shared { ref list, share } in &self.lists {
            let mut args =
                |gather: Option<&Gather>, share| gather.map(|g| g.args(ctx, &mut rec, list, share)).transpose();
            let [inner, last] = self.shares(share);
            let mut both = |gather| Ok(args(gather, inner)?.zip(args(gather, last)?).map(|(i, l)| [i, l]));
            groups.push(Cells {
                gather: both(scatter.gather.as_ref())?,
                lights: both(scatter.lights.as_ref().map(|l| &l.0))?,
                emission: args(scatter.emission.as_ref().map(|e| &e.0), self.first_share(share))?,
                args: list.chunk_args(ctx, &mut rec, 1)?,
                list,
                share,
            });
        }
        if let Some((proxy, _)) = &scatter.proxy {
            proxy.record_clear(&mut rec);
        }
        queue.submit(rec, 0.0, "scattering")?;

        let has_next = self.orders > 1;
        let first = scatter.projection.kept(has_next);
        let single_lights = |queue: &mut Queue<'_>, kept: Kept, lights: Range<u32>| {
            let rays = f64::from(lights.len() as u32 * constants::LIGHT_POINTS);
            for cells in &groups {
                let scattering = self.scattering(scatter, cells, kept);
                self.for_chunks(cells.list, queue, "single scattering", rays, |rec, chunk| {
                    rec.begin_pass("single", 1);
                    scatter.single.record_lights(rec, &scattering, chunk, lights.clone());
                    rec.end_pass();
                })?;
            }
            Ok::<_, Error>(())
        };
        let single_environment = |queue: &mut Queue<'_>, rays: &dyn Fn(Share) -> u32, is_seen: bool| {
            for cells in &groups {
                let scattering = self.scattering(scatter, cells, first);
                let rays = rays(cells.share);
                self.for_chunks(cells.list, queue, "single scattering", rays.into(), |rec, chunk| {
                    rec.begin_pass("single", 1);
                    scatter.single.record_environment(rec, &scattering, chunk, rays, is_seen);
                    rec.end_pass();
                })?;
            }
            Ok::<_, Error>(())
        };
        let separate = scatter.lights.as_ref().map_or(&[][..], |(_, images)| images);
        for (l, image) in separate.iter().enumerate() {
            single_lights(queue, Kept::Mean, l as u32..l as u32 + 1)?;
            let mut rec = Recorder::new(ctx)?;
            rec.begin_pass("project", 1);
            let (projection, nodes) = (&scatter.projection, &scatter.nodes);
            projection.record_solve_mean(&mut rec, data, nodes, &node_args, image, &self.total.a);
            projection.record_clear(&mut rec);
            rec.end_pass();
            queue.submit(rec, 0.0, "scattering")?;
        }
        // What the eye shall see of order 1, then the light that it sees without it (`camera.comp`).
        single_environment(queue, &|share| self.environment_rays(share), true)?;
        if let Some((gather, _)) = &scatter.emission {
            let emitted = Source { a: self.emitted.clone(), b: scatter.source.b.clone() };
            for cells in &groups {
                let scattering = self.scattering(scatter, cells, first);
                let args = cells.emission.as_ref().expect("arguments of the gather of emission");
                let rays = gather.rays(self.first_share(cells.share));
                self.for_chunks(cells.list, queue, "single scattering", rays, |rec, chunk| {
                    gather.record(rec, &scattering, chunk, args, None, &emitted, EMISSION_STREAM, 0, true);
                })?;
            }
        }
        let is_seen = self.environment_rays(Share::ALL) > 0 || scatter.emission.is_some();
        let solve = |queue: &mut Queue<'_>, order, into: &Source, fixed: Option<&Source>, is_seen: bool| {
            self.solve(scatter, &node_args, queue, order, into, fixed, is_seen)
        };
        if is_seen && !scatter.projection.has_eye() {
            solve(queue, 1, &scatter.source, None, true)?;
        }
        let mut decision = None;
        if let Some(gather) = &scatter.gather {
            // What `auto` decided on instead of `gather`, with arguments for every group.
            let mut decided: Option<(Gather, Vec<[GatherArgs; 2]>)> = None;
            // Light of the orders before; `None`: there is none.
            let mut source = None;
            if let Some(fixed) = &scatter.fixed {
                single_lights(queue, first, separate.len() as u32..data.light_count)?;
                solve(queue, 1, fixed, None, false)?;
                source = Some(fixed);
            }
            if self.inner_environment_rays(scatter, Share::ALL) > 0 {
                single_environment(queue, &|share| self.inner_environment_rays(scatter, share), false)?;
                solve(queue, 1, &scatter.source, None, false)?;
                source = Some(&scatter.source);
            }
            for order in 2..=self.orders {
                // `auto`, where there is something to decide, and a pilot is to decide it.
                let mut pilot = None;
                if let Some((auto, source)) = scatter.auto.as_ref().filter(|_| decision.is_none()).zip(source) {
                    decision = self.begin(auto, queue, source, order)?;
                    pilot = decision.clone().filter(AutoStats::is_worth_a_pilot).map(|begun| (auto, source, begun));
                }
                let needs_proxy = scatter.auto.is_none() || pilot.is_some() || decided.is_some();
                let mut rec = Recorder::new(ctx)?;
                if let Some((proxy, mips)) = scatter.proxy.as_ref().filter(|_| needs_proxy) {
                    rec.begin_pass("proxy.means", order);
                    mips.record(&mut rec, &source.unwrap_or(&scatter.source).a, &self.emptiness.image);
                    rec.end_pass();
                    proxy.record(&mut rec, data, encoded, encoded_args, &mips.means[0], order);
                    let at = (constants::PROXY_WORDS * (order - 1)) as usize;
                    rec.barrier(Access::ComputeReadWrite, Access::TransferRead);
                    rec.copy(proxy.control(), 0, &self.proxy_log, at, constants::PROXY_WORDS as usize);
                }
                scatter.projection.record_clear(&mut rec);
                queue.submit(rec, 0.0, "multiple scattering")?;
                if let Some((auto, source, begun)) = pilot {
                    let stats = self.decide(auto, queue, begun, source, order)?;
                    if stats.sampling == Sampling::Residual {
                        let gather =
                            Gather::new(ctx, data, stats.config(&auto.wanted), auto.chunk, Gathered::Projected)?;
                        let mut rec = Recorder::new(ctx)?;
                        let mut args = Vec::new();
                        for cells in &groups {
                            let inner = self.decided_inner_share * cells.share.of_all;
                            let last = self.shares(cells.share)[1];
                            let mut of = |share| gather.args(ctx, &mut rec, cells.list, share);
                            args.push([of(inner)?, of(last)?]);
                        }
                        queue.submit(rec, 0.0, "multiple scattering")?;
                        decided = Some((gather, args));
                    }
                    decision = Some(stats);
                }
                let is_last = order == self.orders;
                for (group, cells) in groups.iter().enumerate() {
                    let scattering = self.scattering(scatter, cells, scatter.projection.kept(!is_last));
                    let share = self.shares(cells.share)[usize::from(is_last)];
                    if let Some((gather, images)) = &scatter.lights {
                        self.gather_lights(cells, queue, gather, images, &scattering, order)?;
                    }
                    let Some(source) = source else { continue };
                    let (gather, args) = match &decided {
                        Some((gather, args)) => (gather, &args[group]),
                        None => (gather, cells.gather.as_ref().expect("arguments of the gather")),
                    };
                    let args = &args[usize::from(is_last)];
                    self.for_chunks(cells.list, queue, "multiple scattering", gather.rays(share), |rec, chunk| {
                        let proxy = self.proxy();
                        gather.record(rec, &scattering, chunk, args, proxy, source, order, 0, is_last);
                    })?;
                }
                source = Some(&scatter.source);
                if !is_last {
                    solve(queue, order, &scatter.source, scatter.fixed.as_ref(), false)?;
                } else if !scatter.projection.has_eye() {
                    solve(queue, order, &scatter.source, None, true)?;
                }
            }
        }
        if scatter.projection.has_eye() {
            let mut rec = Recorder::new(ctx)?;
            rec.begin_pass("project", self.orders);
            let (projection, nodes) = (&scatter.projection, &scatter.nodes);
            projection.record_solve_eye(&mut rec, data, nodes, &node_args, &scatter.source, &self.total.a);
            rec.end_pass();
            queue.submit(rec, 0.0, "scattering")?;
        }
        Ok(decision)
    }

    /// Is a pilot worth its time before the gather of `order`? By the steps of a few rays through `source`. Waits for the device,
    /// once per light. `None`: there are no cells.
    fn begin(&self, auto: &Auto, queue: &mut Queue<'_>, source: &Source, order: u32) -> Result<Option<AutoStats>> {
        let Some(list) = self.piloted() else {
            return Ok(None);
        };
        let looked = self.sample(auto, queue, Look::First, list, source, order)?;
        let steps = auto::steps_per_ray(&looked, auto.pilot.directions(Look::First), |s| s.traced_steps);
        let rays = auto.pilot.rays(Look::Pilot, list);
        let begun = auto::begin(steps, &auto.costs, &self.work(order), &auto.wanted, rays);
        Ok(Some(AutoStats { iteration: order, ..begun }))
    }

    /// Lets a pilot decide how the gathers from `order` on draw their directions; `source` and its proxy are there. Waits for
    /// the device, once per light.
    fn decide(
        &self,
        auto: &Auto,
        queue: &mut Queue<'_>,
        begun: AutoStats,
        source: &Source,
        order: u32,
    ) -> Result<AutoStats> {
        let list = self.piloted().expect("begun without cells");
        let looked = self.sample(auto, queue, Look::Pilot, list, source, order)?;
        let found = auto::Found::of(&looked, auto.pilot.directions(Look::Pilot));
        let words = (chunk_bytes(self.ctx) / (4 * u64::from(auto.chunk))) as u32;
        Ok(auto::decide(begun, &found, &auto.costs, &self.work(order), &auto.wanted, words))
    }

    /// The cells of the pilot: those that the eye sees, as long as it sees something.
    fn piloted(&self) -> Option<&List> {
        self.lists.iter().map(|l| &l.list).find(|list| Pilot::cells(list) > 0)
    }

    fn sample(
        &self,
        auto: &Auto,
        queue: &mut Queue<'_>,
        look: Look,
        list: &List,
        source: &Source,
        order: u32,
    ) -> Result<[Vec<PilotSample>; constants::PILOT_REPLICATES as usize]> {
        let mut rec = Recorder::new(self.ctx)?;
        rec.begin_pass(if look == Look::First { "pilot.first" } else { "pilot" }, order);
        let proxy = self.proxy().expect("`auto` has a proxy");
        auto.pilot.record(&mut rec, look, &self.data, &self.emptiness.image, list, proxy, source);
        rec.end_pass();
        queue.submit(rec, 0.0, "multiple scattering")?;
        auto.pilot.samples(self.ctx, look, list)
    }

    /// What is left to be gathered, from `order` on.
    fn work(&self, order: u32) -> auto::Work {
        let later = f64::from(self.orders - order);
        let mut work = auto::Work { shares: 0.0, cells: 0.0, voxels: self.data.voxels() as f64, later };
        for Shared { list, share } in &self.lists {
            let cells = list.items() as f64;
            let [inner, last] = self.shares(*share).map(f64::from);
            work.shares += cells * (later * inner + last);
            work.cells += cells * (later + if last > 0.0 { 1.0 } else { 0.0 });
        }
        work
    }

    /// What rays read that need extinction alone.
    fn extinction(&self) -> &Image {
        self.classify.extinction(&self.total.a)
    }

    /// What scatters light in `cells`.
    fn scattering<'s>(&'s self, scatter: &'s Scatter, cells: &'s Cells<'_>, kept: Kept) -> Scattering<'s> {
        Scattering {
            scene: &self.data,
            emptiness: &self.emptiness.image,
            field: self.extinction(),
            projection: &scatter.projection,
            args: &cells.args,
            kept,
        }
    }

    /// Order 2 of the delta lights whose order 1 is in `images`, for the orders up to `order`.
    fn gather_lights(
        &self,
        cells: &Cells<'_>,
        queue: &mut Queue<'_>,
        gather: &Gather,
        images: &[Image],
        scattering: &Scattering<'_>,
        order: u32,
    ) -> Result<()> {
        let is_last = order == self.orders;
        let args = &cells.lights.as_ref().expect("arguments of the lights' gather")[usize::from(is_last)];
        let rays = gather.rays(self.shares(cells.share)[usize::from(is_last)]);
        for (l, image) in images.iter().enumerate() {
            let source = Source { a: image.clone(), b: [image.clone(), image.clone(), image.clone()] };
            self.for_chunks(cells.list, queue, "multiple scattering", rays, |rec, chunk| {
                let stream = LIGHT_STREAM ^ (order * MOST_SEPARATE_LIGHTS + l as u32);
                gather.record(rec, scattering, chunk, args, None, &source, stream, l as u32, is_last);
            })?;
        }
        Ok(())
    }

    /// Solves for the source of `order`, to which `fixed` is added; `is_seen`: the eye shall see what is solved for.
    #[allow(clippy::too_many_arguments, reason = "as Projection::record_solve")]
    fn solve(
        &self,
        scatter: &Scatter,
        node_args: &ChunkArgs,
        queue: &mut Queue<'_>,
        order: u32,
        into: &Source,
        fixed: Option<&Source>,
        is_seen: bool,
    ) -> Result<()> {
        let mut rec = Recorder::new(self.ctx)?;
        rec.begin_pass("project", order);
        let (projection, nodes, total) = (&scatter.projection, &scatter.nodes, &self.total);
        projection.record_solve(&mut rec, &self.data, nodes, node_args, into, fixed, total, is_seen);
        rec.end_pass();
        queue.submit(rec, 0.0, "scattering")
    }

    /// Records `body` for every chunk, a few chunks per submission, if there is any work for its items.
    fn for_chunks(
        &self,
        list: &List,
        queue: &mut Queue<'_>,
        phase: &'static str,
        work_per_item: f64,
        mut body: impl FnMut(&mut Recorder, &Chunk<'_>),
    ) -> Result<()> {
        const CHUNKS_PER_SUBMISSION: usize = 4;
        if work_per_item == 0.0 {
            return Ok(());
        }
        let chunks: Vec<_> = list.chunks().collect();
        let work = work_per_item * list.items() as f64 / chunks.len().max(1) as f64;
        for group in chunks.chunks(CHUNKS_PER_SUBMISSION) {
            let mut rec = Recorder::new(self.ctx)?;
            for chunk in group {
                body(&mut rec, chunk);
            }
            queue.submit(rec, work * group.len() as f64, phase)?;
        }
        Ok(())
    }

    fn take_picture(&self, queue: &mut Queue<'_>) -> Result<()> {
        for sample in 0..self.samples {
            for rows in bands(self.ctx, self.data.params.size) {
                let work = self.row_work() * rows.len() as f64;
                let mut rec = Recorder::new(self.ctx)?;
                rec.begin_pass("camera", 0);
                let (total, emitted, picture) = (&self.total, &self.emitted, &self.picture);
                let (extinction, emptiness) = (self.extinction(), &self.emptiness.image);
                self.camera.record(&mut rec, &self.data, emptiness, total, extinction, emitted, picture, sample, rows);
                rec.end_pass();
                queue.submit(rec, work, "camera")?;
            }
        }
        Ok(())
    }

    /// The proxy of the last order that built one, for tests.
    pub fn proxy(&self) -> Option<&Proxy> {
        self.scatter.as_ref()?.proxy.as_ref().map(|(proxy, _)| proxy)
    }

    /// Cells of the latest render, for tests: those that get all directions, and of the others those that the last gather
    /// serves and those that it does not.
    pub fn listed_cells(&self) -> [u64; 3] {
        let mut cells = [0; 3];
        for Shared { list, share } in &self.lists {
            let kind = match self.shares(*share)[1] {
                1.0 => 0,
                0.0 => 2,
                _ => 1,
            };
            cells[kind] += list.items();
        }
        cells
    }

    /// Is light stored in one channel, as the scene has no colour?
    pub fn stores_grey(&self) -> bool {
        self.data.stored.is_grey
    }

    /// Active voxels of the latest render.
    pub fn active_voxels(&self) -> u64 {
        self.active
    }

    /// Figures of the latest render. `wall_ms` is what the caller measured.
    pub fn stats(&self, scene: &Scene, wall_ms: f64) -> Result<Stats> {
        self.stats_of(scene, &self.times, wall_ms)
    }

    /// The same with the times that [`Taken::finish`] gave.
    pub fn stats_of(&self, scene: &Scene, times: &[TimedPass], wall_ms: f64) -> Result<Stats> {
        let passes = pass_stats(times);
        let mut proxies = Vec::new();
        if let Some(proxy) = self.proxy() {
            let log = self.ctx.read_back(&self.proxy_log)?;
            for order in self.orders_with_proxy() {
                let at = (constants::PROXY_WORDS * (order - 1)) as usize;
                let counts = proxy.counts(&log[at..at + constants::PROXY_WORDS as usize]);
                let is_build = |p: &&PassStats| p.iteration == order && p.name.starts_with("proxy.");
                proxies.push(ProxyStats {
                    iteration: order,
                    voxels: self.data.voxels(),
                    runs: counts.runs.into(),
                    buckets: counts.buckets.into(),
                    bytes: proxy.bytes(),
                    build_ms: passes.iter().filter(is_build).map(|p| p.ms).sum(),
                    mask_requested: self.mask,
                    mask_used: counts.mask,
                    levels: counts.levels,
                    hash_bits: counts.hash_bits(),
                });
            }
        }
        let volume = VolumeStats::of(&scene.volume, self.active_fraction());
        let stats = Stats::new(self.ctx, scene, volume, passes, proxies, wall_ms);
        Ok(Stats { auto: self.decision.clone(), ..stats })
    }

    /// The orders whose gathers had a proxy: with `auto` the pilot's, and those after it where it decided so.
    fn orders_with_proxy(&self) -> RangeInclusive<u32> {
        match (self.scatter.as_ref().and_then(|s| s.auto.as_ref()), &self.decision) {
            (None, _) => 2..=self.orders,
            (Some(_), Some(auto)) if auto.sampling == Sampling::Residual => auto.iteration..=self.orders,
            (Some(_), Some(auto)) if auto.pilot.is_some() => auto.iteration..=auto.iteration,
            (Some(_), _) => RangeInclusive::new(1, 0),
        }
    }

    fn active_fraction(&self) -> f64 {
        self.active as f64 / self.data.voxels() as f64
    }
}

/// Submissions under way: at most `DEPTH`, so that progress is known and little is lost when the render is stopped.
struct Queue<'p> {
    progress: &'p mut dyn FnMut(Progress) -> ControlFlow<()>,
    in_flight: VecDeque<(Submission, f64, &'static str)>,
    times: Vec<TimedPass>,
    done: f64,
    total: f64,
}

const DEPTH: usize = 3;

impl<'p> Queue<'p> {
    fn new(progress: &'p mut dyn FnMut(Progress) -> ControlFlow<()>) -> Self {
        Self { progress, in_flight: VecDeque::new(), times: Vec::new(), done: 0.0, total: 0.0 }
    }

    fn submit(&mut self, rec: Recorder, work: f64, phase: &'static str) -> Result<()> {
        self.in_flight.push_back((rec.submit()?, work, phase));
        while self.in_flight.len() > DEPTH {
            self.wait_for_oldest()?;
        }
        Ok(())
    }

    fn wait_for_oldest(&mut self) -> Result<()> {
        let Some((submission, work, phase)) = self.in_flight.pop_front() else { return Ok(()) };
        self.times.extend(submission.wait()?);
        self.done += work;
        let done = if self.total > 0.0 { (self.done / self.total).min(1.0) } else { 0.0 };
        match (self.progress)(Progress { done, phase }) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(stopped()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inner_gathers_have_a_direction_for_every_point() {
        let of = |directions, share| {
            let settings = Settings { directions, inner_share: share, ..Settings::default() };
            share_of(directions, inner_share(&settings, Sampling::Phase))
        };
        let all: Vec<u32> = [1, 7, 8, 9, 16, 24, 48, 1024].iter().map(|&n| of(n, 0.33)).collect();
        assert_eq!(all, [1, 7, 8, 8, 8, 8, 16, 338]);
        assert_eq!(inner_share(&Settings { directions: 8, ..Settings::default() }, Sampling::Residual), 0.33);
        assert!((1..=1024).all(|n| of(n, 0.001) == n.min(8).max((n as f32 * 0.001).ceil() as u32)));
    }
}
