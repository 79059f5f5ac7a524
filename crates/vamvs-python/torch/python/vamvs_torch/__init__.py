"""The extension of the package vamvs, with libtorch. Nothing here is for use: import vamvs."""

import ctypes
import importlib.util
from pathlib import Path

# Libraries of the torch package that the extension needs, in the order of loading.
_LIBRARIES = ("libc10.so", "libtorch_cpu.so")
# Libraries for GPUs, if they exist.
_CUDA = ("libc10_cuda.so", "libtorch_cuda.so")


def _load_libraries() -> None:
    torch = importlib.util.find_spec("torch")
    if torch is None or not torch.submodule_search_locations:
        raise ImportError("vamvs-torch needs the package torch, version 2.11.0: pip install torch==2.11.0")
    folder = Path(torch.submodule_search_locations[0]) / "lib"
    # libtorch_cpu.so needs two CUDA libraries even without a GPU. Its run path finds them in the
    # packages next to torch.
    if not (folder / "libtorch_cpu.so").is_file():
        import torch  # noqa: F401  (another platform: torch knows its libraries)

        return
    for name in _LIBRARIES:
        ctypes.CDLL(str(folder / name))
    if Path("/dev/nvidiactl").exists():
        for name in _CUDA:
            if (folder / name).is_file():
                ctypes.CDLL(str(folder / name))


_load_libraries()

from . import _vamvs  # noqa: E402
