"""Depth maps, normals and a cloud of a COLMAP model, step by step, with a picture of what each step gives.

    pip install pillow
    python depth_maps.py sparse/0 images picture.png
"""

import sys

import numpy as np
from PIL import Image

import vamvs

WIDTH = 384  # of a picture's column, pixels


def colours(values, valid):
    """Blue (near) over green to red (far), by rank; grey where there is nothing."""
    ranks = np.zeros(values.shape)
    ranks[valid] = np.argsort(np.argsort(values[valid])) / max(valid.sum() - 1, 1)
    channels = [np.clip(1.5 - abs(4 * ranks - centre), 0, 1) for centre in (3, 2, 1)]
    image = (255 * np.stack(channels, axis=-1)).astype(np.uint8)
    image[~valid] = 40
    return image


def row(view, cloud):
    """The photograph, depth map, normals and confidence of a view, and the cloud seen from there, side by side."""
    valid = view.depth > 0
    normal = (127.5 + 127.5 * view.normal).astype(np.uint8)
    normal[~valid] = 40
    confidence = np.repeat((255 * view.confidence).astype(np.uint8)[..., None], 3, axis=-1)
    parts = [view.colour, colours(view.depth, valid), normal, confidence, seen(cloud, view)]
    height = WIDTH * view.depth.shape[0] // view.depth.shape[1]
    return np.hstack([np.asarray(Image.fromarray(part).resize((WIDTH, height))) for part in parts])


def seen(cloud, view):
    """The cloud as the view sees it: each pixel has the colour of its nearest point."""
    in_camera = cloud.points @ view.cam_from_world[:3, :3].T + view.cam_from_world[:3, 3]
    order = np.argsort(-in_camera[:, 2])  # far points first, so that near ones are painted over them
    order = order[in_camera[order, 2] > 0]
    pixels = (in_camera[order] @ view.K.T)[:, :2] / in_camera[order, 2:]
    x, y = np.floor(pixels).astype(int).T
    height, width = view.depth.shape
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    image = np.full((height, width, 3), 40, np.uint8)
    image[y[inside], x[inside]] = cloud.colours[order[inside]]
    return image


def main():
    model, images, picture = sys.argv[1:4]
    scene = vamvs.Scene.from_colmap(model, images)
    maps = []
    for view in scene.depth_maps(weights="vis-corr", max_size=800):
        height, width = view.depth.shape
        print(f"{view.name}: depth for {100 * (view.depth > 0).mean():.0f} % of {width}x{height}")
        maps.append(view)
    cloud = vamvs.fuse(maps)
    print(f"{len(cloud)} points")
    Image.fromarray(np.vstack([row(view, cloud) for view in maps[:3]])).save(picture)


if __name__ == "__main__":
    main()
