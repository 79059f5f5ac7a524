from collections.abc import Callable, Iterable, Iterator, Sequence
from os import PathLike
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

Path = Union[str, PathLike[str]]
# A dictionary with "kind": "warning" (and "text"), "depth_map" ("name", "pass", "done", "total", "resumed", "seconds"),
# "fusion", "report" or "export" ("done", "total"). Returning False ends the work with an Error.
OnEvent = Callable[[dict[str, Any]], Optional[bool]]

__version__: str

class Error(Exception):
    """What went wrong, with the file, line or field, what was expected and what was found."""

class Cancelled(Error):
    """on_event ended the work."""

class Scene:
    """Views with known cameras, and where their photographs are."""

    names: list[str]
    @staticmethod
    def from_colmap(model: Path, images: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_mvsnet(cams: Path, images: Path, pairs: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_nerfstudio(transforms: Path, images: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_bundler(bundle: Path, images: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_nvm(nvm: Path, images: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_openmvs(mvs: Path, images: Optional[Path] = None) -> Scene: ...
    @staticmethod
    def from_arrays(
        images: Sequence[npt.NDArray[np.uint8]],
        K: Sequence[npt.NDArray[np.float64]],
        cam_from_world: Sequence[npt.NDArray[np.float64]],
        names: Optional[Sequence[str]] = None,
        masks: Optional[Sequence[Optional[npt.NDArray[np.bool_]]]] = None,
    ) -> Scene:
        """Undistorted photographs (H, W, 3), intrinsics (3, 3) for pixel centres at (0.5, 0.5), poses (3, 4) or (4, 4)."""
    def __len__(self) -> int: ...
    def depth_maps(
        self,
        weights: Optional[Path] = None,
        device: Optional[str] = None,
        on_event: Optional[OnEvent] = None,
        **options: Any,
    ) -> DepthMaps:
        """The depth maps, one by one; the next is made while the caller uses the one before.

        Options are quality ('draft', 'normal' or 'best') and those of run.toml's [depth], with
        underscores."""

class DepthMaps(Iterator[DepthMap]):
    def __next__(self) -> DepthMap: ...

class DepthMap:
    """A depth map. Each access to an array gives a new copy of it: keep it to change it."""

    name: str
    depth: npt.NDArray[np.float32]
    """(H, W), scene units along the optical axis; 0 = none."""
    confidence: npt.NDArray[np.float32]
    """(H, W), how likely the depth is right, 0 to 1."""
    normal: Optional[npt.NDArray[np.float32]]
    """(H, W, 3), unit normals in the world, towards the camera; 0 = none."""
    sigma: Optional[npt.NDArray[np.float32]]
    """(H, W), standard deviation of the depth, scene units; 0 = none."""
    colour: npt.NDArray[np.uint8]
    """(H, W, 3), the undistorted photograph."""
    K: npt.NDArray[np.float64]
    """(3, 3), for pixel centres at (0.5, 0.5)."""
    cam_from_world: npt.NDArray[np.float64]
    """(3, 4), [R | t]: a point X of the world is at R X + t in the camera's frame, z forwards, y down."""
    def __init__(
        self,
        name: str,
        depth: npt.NDArray[np.float32],
        K: npt.NDArray[np.float64],
        cam_from_world: npt.NDArray[np.float64],
        colour: npt.NDArray[np.uint8],
        confidence: Optional[npt.NDArray[np.float32]] = None,
        normal: Optional[npt.NDArray[np.float32]] = None,
        sigma: Optional[npt.NDArray[np.float32]] = None,
    ) -> None: ...

class Cloud:
    points: npt.NDArray[np.float64]
    """(N, 3), world."""
    normals: npt.NDArray[np.float32]
    """(N, 3), unit length."""
    colours: npt.NDArray[np.uint8]
    """(N, 3), red, green, blue."""
    confidence: npt.NDArray[np.float32]
    """(N,)."""
    sigma: npt.NDArray[np.float32]
    """(N,), standard deviation along the ray from the camera, scene units; 0 = not known."""
    views: npt.NDArray[np.uint16]
    """(N,), how many views agree on the point."""
    def __len__(self) -> int: ...
    def save(self, path: Path) -> None:
        """Writes a PLY file."""

class Reconstructed:
    cloud: str
    points: int
    made: int
    resumed: int
    left_out: list[tuple[str, str]]

def reconstruct(
    images: Optional[Path] = None,
    *,
    out: Path,
    colmap: Optional[Path] = None,
    cams: Optional[Path] = None,
    pairs: Optional[Path] = None,
    nerfstudio: Optional[Path] = None,
    bundler: Optional[Path] = None,
    nvm: Optional[Path] = None,
    openmvs: Optional[Path] = None,
    weights: Optional[Path] = None,
    device: Optional[str] = None,
    force: bool = False,
    on_event: Optional[OnEvent] = None,
    **options: Any,
) -> Reconstructed:
    """Makes depth maps and fused.ply in the folder `out`; an interrupted run goes on where it was.

    It writes neither run.toml nor a report, and no cloud if no point passes the filters.

    Options are quality ('draft', 'normal' or 'best') and those of run.toml's [depth] and [fusion], with underscores."""

class Mesh:
    vertices: npt.NDArray[np.float64]
    """(N, 3), world."""
    normals: npt.NDArray[np.float32]
    """(N, 3), unit length, to the outside."""
    colours: npt.NDArray[np.uint8]
    """(N, 3), red, green, blue."""
    triangles: npt.NDArray[np.uint32]
    """(M, 3), vertices, counter-clockwise seen from outside."""
    def save(self, path: Path) -> None:
        """Writes a PLY, OBJ or GLB file, as the name says."""

def mesh(
    maps: Iterable[DepthMap], on_event: Optional[OnEvent] = None, **options: Any
) -> Mesh:
    """Makes a triangle mesh of depth maps; options are those of run.toml's [mesh] and [fusion]."""

def fuse(
    maps: Iterable[DepthMap], on_event: Optional[OnEvent] = None, **options: Any
) -> Cloud:
    """Fuses depth maps; options are those of run.toml's [fusion]."""
