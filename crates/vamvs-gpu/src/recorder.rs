//! A list of kernels to run one after the other.

use wgpu::{Buffer, BufferUsages, CommandEncoder};

use crate::Gpu;
use crate::kernels::Kernel;

/// The most groups of invocations along an axis.
const MOST_GROUPS: u32 = 65535;

/// Operations after which the device is given what was recorded, so that no submission takes long and memory is freed meanwhile.
pub const MOST_OPERATIONS: u64 = 4_000_000_000;

/// Records kernels, and gives them to the device.
pub struct Recorder<'a> {
    pub gpu: &'a Gpu,
    encoder: CommandEncoder,
    /// Operations that were recorded since.
    operations: u64,
}

/// Parameters of a kernel, word by word, as WGSL lays them out.
#[derive(Default)]
pub struct Words(Vec<u32>);

impl Words {
    pub fn new() -> Self {
        Self::default()
    }

    pub fn count(mut self, value: usize) -> Self {
        self.0.push(u32::try_from(value).expect("sides of maps are far below four thousand millions"));
        self
    }

    pub fn counts(self, values: &[usize]) -> Self {
        values.iter().fold(self, |words, value| words.count(*value))
    }

    pub fn flag(self, value: bool) -> Self {
        self.count(usize::from(value))
    }

    pub fn number(mut self, value: f32) -> Self {
        self.0.push(value.to_bits());
        self
    }

    /// All of them.
    pub fn all(self) -> Vec<u32> {
        self.0
    }

    pub fn numbers(self, values: &[f32]) -> Self {
        values.iter().fold(self, |words, value| words.number(*value))
    }
}

impl<'a> Recorder<'a> {
    pub fn new(gpu: &'a Gpu) -> Self {
        Self { gpu, encoder: gpu.device.create_command_encoder(&Default::default()), operations: 0 }
    }

    /// One kernel over so many invocations along x, y and z. Its bindings are the parameters, then the buffers in their order.
    pub fn run(&mut self, kernel: &Kernel, parameters: Words, buffers: &[&Buffer], [x, y, z]: [usize; 3]) {
        let Words(mut words) = parameters;
        words.resize(words.len().next_multiple_of(4), 0);
        let device = &self.gpu.device;
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * words.len() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.gpu.queue.write_buffer(&uniform, 0, bytemuck::cast_slice(&words));
        let entries: Vec<wgpu::BindGroupEntry<'_>> = std::iter::once(&&uniform)
            .chain(buffers)
            .zip(0..)
            .map(|(buffer, binding)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = self.encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        let [width, height] = kernel.group;
        let groups = |invocations: usize, group: u32| (invocations as u32).div_ceil(group);
        let (mut across, mut down) = (groups(x, width), groups(y, height));
        if height == 1 {
            // Kernels over pixels in a row number them over rows of groups too.
            down = across.div_ceil(MOST_GROUPS);
            across = across.div_ceil(down.max(1));
        }
        pass.dispatch_workgroups(across, down, z as u32);
    }

    /// Counts operations of convolutions that were recorded.
    pub fn count(&mut self, operations: u64) {
        self.gpu.count(operations);
        self.limit(operations);
    }

    /// Gives the device what was recorded where it becomes much.
    pub fn limit(&mut self, operations: u64) {
        self.operations += operations;
        if self.operations >= MOST_OPERATIONS {
            self.submit();
        }
    }

    /// Gives the device all that was recorded.
    pub fn submit(&mut self) {
        let next = self.gpu.device.create_command_encoder(&Default::default());
        let recorded = std::mem::replace(&mut self.encoder, next);
        self.gpu.queue.submit([recorded.finish()]);
        self.operations = 0;
    }
}
