//! The libtorch that the workspace is built against: its version, and the wheels and the files in them that are needed.
//!
//! tch binds exactly one version. The Python wheel of torch contains that libtorch. Of its 1.2 GB a build for the CPU
//! needs the headers and three libraries. libtorch_cpu also links two small CUDA libraries, even on a machine without a
//! GPU; they are in two further wheels.

/// The version that the pinned tch binds.
pub const VERSION: &str = "2.11.0";

/// A wheel of the Python package index, and the files in it that are needed.
pub struct Wheel {
    /// Name and version, as pip takes them.
    pub requirement: &'static str,
    /// Platform tag of the wheel, as pip takes it.
    pub platform: &'static str,
    /// File name.
    pub file: &'static str,
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: &'static str,
    /// Files, and folders with a final `/`: path in the wheel, and path in the libtorch folder.
    pub parts: &'static [(&'static str, &'static str)],
}

/// The wheels from which the libtorch for the CPU is assembled.
pub const WHEELS: [Wheel; 3] = [
    Wheel {
        requirement: "torch==2.11.0",
        platform: "manylinux_2_28_x86_64",
        file: "torch-2.11.0-cp312-cp312-manylinux_2_28_x86_64.whl",
        sha256: "0f68f4ac6d95d12e896c3b7a912b5871619542ec54d3649cf48cc1edd4dd2756",
        parts: &[
            ("torch/include/", "include/"),
            ("torch/lib/libc10.so", "lib/libc10.so"),
            ("torch/lib/libgomp.so.1", "lib/libgomp.so.1"),
            ("torch/lib/libtorch_cpu.so", "lib/libtorch_cpu.so"),
            ("torch-2.11.0.dist-info/licenses/", "licenses/torch/"),
        ],
    },
    Wheel {
        requirement: "nvidia-cuda-runtime==13.0.96",
        platform: "manylinux2014_x86_64",
        file: "nvidia_cuda_runtime-13.0.96-py3-none-manylinux2014_x86_64.manylinux_2_17_x86_64.whl",
        sha256: "7f82250d7782aa23b6cfe765ecc7db554bd3c2870c43f3d1821f1d18aebf0548",
        parts: &[
            ("nvidia/cu13/lib/libcudart.so.13", "lib/libcudart.so.13"),
            ("nvidia_cuda_runtime-13.0.96.dist-info/licenses/", "licenses/cuda-runtime/"),
        ],
    },
    Wheel {
        requirement: "nvidia-cuda-cupti==13.0.85",
        platform: "manylinux_2_25_x86_64",
        file: "nvidia_cuda_cupti-13.0.85-py3-none-manylinux_2_25_x86_64.whl",
        sha256: "4eb01c08e859bf924d222250d2e8f8b8ff6d3db4721288cf35d14252a4d933c8",
        parts: &[
            ("nvidia/cu13/lib/libcupti.so.13", "lib/libcupti.so.13"),
            ("nvidia_cuda_cupti-13.0.85.dist-info/licenses/", "licenses/cuda-cupti/"),
        ],
    },
];

/// Path and text of the linker script that replaces the wheel's `libtorch.so`, which torch-sys links. The original
/// would pull in all of CUDA.
pub const LINKER_SCRIPT: (&str, &str) = ("lib/libtorch.so", "INPUT(libtorch_cpu.so)\n");
