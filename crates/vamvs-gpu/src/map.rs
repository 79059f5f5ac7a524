//! Images and volumes of features in the device's memory.

use wgpu::{Buffer, BufferUsages};

use crate::{Gpu, GpuError};

/// A volume of features, or an image, which has one plane; channels last, in vectors of four.
pub struct Map {
    /// Planes, height, width.
    pub sides: [usize; 3],
    /// Vectors of four channels; those beyond the channels are zero.
    pub vectors: usize,
    pub buffer: Buffer,
}

impl Map {
    /// A map whose values are to be written.
    pub fn new(gpu: &Gpu, sides: [usize; 3], vectors: usize) -> Result<Self, GpuError> {
        let bytes = sides.iter().product::<usize>() * vectors * 16;
        Ok(Self { sides, vectors, buffer: gpu.buffer(bytes)? })
    }
}

impl Gpu {
    /// Memory of the device for kernels to work on.
    pub fn buffer(&self, bytes: usize) -> Result<Buffer, GpuError> {
        let largest = self.adapter().largest_buffer;
        if bytes as u64 > largest {
            return Err(GpuError::Memory {
                adapter: self.adapter().name.clone(),
                problem: format!("a map takes {bytes} bytes, and a kernel can use {largest}"),
            });
        }
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes as u64,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }))
    }

    /// Memory of the device with these values.
    pub fn upload<T: bytemuck::NoUninit>(&self, values: &[T]) -> Result<Buffer, GpuError> {
        let bytes = bytemuck::cast_slice(values);
        let buffer = self.buffer(bytes.len())?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// The values of a part of the device's memory, which is waited for.
    pub fn download(&self, buffer: &Buffer) -> Result<Vec<f32>, GpuError> {
        self.download_as(buffer, <[f32]>::to_vec)
    }

    /// What `read` makes of them.
    pub fn download_as<T>(&self, buffer: &Buffer, read: impl FnOnce(&[f32]) -> T) -> Result<T, GpuError> {
        let failed = |problem: String| GpuError::Device { adapter: self.adapter().name.clone(), problem };
        let copy = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: buffer.size(),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        copy.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait()?;
        let view = copy.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
        Ok(read(bytemuck::cast_slice(&view)))
    }
}
