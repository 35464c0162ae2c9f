//! A scene with its light scattered once: what benches send rays through.

use crate::passes::bench_rays::RayInputs;
use crate::passes::classify::{Classify, Emitted};
use crate::passes::compact::{ChunkArgs, List, Listed, Marks};
use crate::passes::emptiness::Emptiness;
use crate::passes::project::{Kept, Projection, Scattering, Source};
use crate::passes::proxy::Proxy;
use crate::passes::scene_data::SceneData;
use crate::passes::single_scatter::SingleScatter;
use crate::scene::Scene;
use crate::shaders::constants;
use crate::vk::{Context, Image, Recorder};
use crate::{Error, Result};

/// The scene on the device.
pub struct Lit {
    /// Its numbers.
    pub data: SceneData,
    /// What rays skip by.
    pub emptiness: Emptiness,
    /// Order 1 of the light of lights and environment: rgb = source function, a = extinction.
    pub source: Image,
    /// Voxels that have light.
    pub nodes: List,
    /// Cells with extinction.
    pub cells: List,
}

impl Lit {
    /// Classifies the volume and scatters the light once, isotropically: one value per voxel is all that rays need here.
    /// `chunk`: list items of a dispatch.
    ///
    /// Errors: nothing in the medium has extinction, or no light reaches it.
    pub fn new(ctx: &Context, mut scene: Scene, chunk: u32) -> Result<Self> {
        scene.g = 0.0;
        scene.settings.light_grid = 1;
        let data = SceneData::new(ctx, &scene)?;
        let dims = data.params.dims;
        let field = data.field(ctx, "field", dims)?;
        let emptiness = Emptiness::for_rays(ctx, dims)?;
        let blocks = data.light_blocks();
        let marks = Marks::new(ctx, blocks)?;
        let mut cells = List::new(ctx, blocks, Listed::Cells, chunk, None)?;
        let mut nodes = List::new(ctx, blocks, Listed::Nodes, chunk, None)?;
        let mut rec = Recorder::new(ctx)?;
        Classify::new(ctx, &data, Emitted::Nothing)?.record(&mut rec, &data, &field);
        emptiness.record(&mut rec, &data, &field);
        marks.record(&mut rec, &data, &field, &emptiness);
        cells.record(&mut rec, &data, &marks);
        nodes.record(&mut rec, &data, &marks);
        rec.submit_and_wait()?;
        nodes.read_counts(ctx)?;
        if cells.read_counts(ctx)? == 0 {
            return Err(Error::input(
                "scene",
                "nothing in the volume has extinction",
                "choose another preset or window",
            ));
        }
        let source = Source::new(ctx, &data, "source", false)?;
        let lit = Self { data, emptiness, source: source.a.clone(), nodes, cells };
        lit.scatter(ctx, &scene, chunk, &field, &source)?;
        Ok(lit)
    }

    fn scatter(&self, ctx: &Context, scene: &Scene, chunk: u32, field: &Image, source: &Source) -> Result<()> {
        let settings = &scene.settings;
        let single = SingleScatter::new(ctx, &self.data, settings.gather_step)?;
        let projection = Projection::new(ctx, &self.data, chunk, settings.projection_steps, true, settings.light_for)?;
        let mut rec = Recorder::new(ctx)?;
        let args = self.cells.chunk_args(ctx, &mut rec, 1)?;
        source.clear(&mut rec);
        projection.record_clear_all(&mut rec);
        rec.submit_and_wait()?;
        let scattering = Scattering {
            scene: &self.data,
            emptiness: &self.emptiness.image,
            field,
            projection: &projection,
            args: &args,
            kept: Kept::Mean,
        };
        for chunk in self.cells.chunks() {
            let mut rec = Recorder::new(ctx)?;
            if self.data.environment != constants::ENVIRONMENT_NONE {
                single.record_environment(&mut rec, &scattering, &chunk, settings.environment_directions, false);
            }
            single.record_lights(&mut rec, &scattering, &chunk, 0..self.data.light_count);
            rec.submit_and_wait()?;
        }
        let mut rec = Recorder::new(ctx)?;
        let args = self.node_args(ctx, &mut rec)?;
        // Nothing is seen: of what would be added to, only the extinction is read.
        let total = Source { a: field.clone(), b: source.b.clone() };
        projection.record_solve(&mut rec, &self.data, &self.nodes, &args, source, None, &total, false);
        rec.submit_and_wait()?;
        Ok(())
    }

    /// What rays through the source, or through the buckets of `proxy`, read; `means` over its voxels take the place of coarser ones.
    pub fn ray_inputs<'a>(&'a self, proxy: &'a Proxy, means: &'a Image) -> RayInputs<'a> {
        RayInputs {
            source: &self.source,
            emptiness: &self.emptiness.image,
            skips: &self.emptiness.image,
            values: proxy.bucket_id(),
            bucket_light: proxy.bucket_light(),
            coarse_values: [proxy.bucket_id(); 2],
            coarse_source: [means; 2],
        }
    }

    /// Arguments for kernels over [`Lit::nodes`].
    pub fn node_args(&self, ctx: &Context, rec: &mut Recorder) -> Result<ChunkArgs> {
        self.nodes.chunk_args(ctx, rec, 1)
    }
}
