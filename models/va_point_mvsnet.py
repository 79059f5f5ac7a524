"""The network of Chen et al., "Visibility-Aware Point-Based Multi-View Stereo Network" (TPAMI 2020).

Layer sizes are those of the authors' implementation. The module holds what is learned; the geometry
between its methods (warping, lifting, neighbours, the reduction over views) is in the Rust crate
`vamvs-net`. The contract between both is in README.md beside this file.
"""

import json
from typing import Final

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from layers import Conv1d, Conv2d, Conv3d, Deconv3d, normalisation, scale_shift

AGGREGATIONS = ("avg", "max", "var", "vis-avg", "vis-max", "vis-var")
NEIGHBOURS = 16
HYPOTHESES = 2  # to each side of a point (m)
POSITION_CHANNELS = 24  # x, y, z, repeated 8 times
FLOW_CHANNELS = (16, 32, 64)
CHUNK = 4096  # points whose neighbours are gathered at once, so that they stay in the cache


class ImageNet(nn.Module):
    """Image pyramid (section 3.1): (B, 3, H, W) → 16 channels at 1/2, 32 at 1/4, 64 at 1/8."""

    def __init__(self, norm: str) -> None:
        super().__init__()
        self.level0 = nn.Sequential(Conv2d(3, 8, 3, 1, norm), Conv2d(8, 8, 3, 1, norm))
        self.level1 = nn.Sequential(Conv2d(8, 16, 5, 2, norm), Conv2d(16, 16, 3, 1, norm), Conv2d(16, 16, 3, 1, norm))
        self.level2 = nn.Sequential(Conv2d(16, 32, 5, 2, norm), Conv2d(32, 32, 3, 1, norm), Conv2d(32, 32, 3, 1, norm))
        self.level3 = nn.Sequential(Conv2d(32, 64, 5, 2, norm), Conv2d(64, 64, 3, 1, norm))
        self.last = nn.Conv2d(64, 64, 3, padding=1, bias=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        # Each photograph to zero mean and unit deviation, as the authors do.
        mean = images.mean(dim=(1, 2, 3), keepdim=True)
        deviation = images.std(dim=(1, 2, 3), keepdim=True)
        half = self.level1(self.level0((images - mean) / (deviation + 1e-3)))
        quarter = self.level2(half)
        eighth = self.last(self.level3(quarter))
        return half, quarter, eighth


class VolumeNet(nn.Module):
    """Cost-volume regularisation (section 3.2), a 3D U-Net: (B, C, D, h, w) → (B, D, h, w)."""

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        self.scale1 = Conv3d(channels, 8, 1, norm)
        self.scale2 = Conv3d(channels, 16, 2, norm)
        self.scale2_same = Conv3d(16, 16, 1, norm)
        self.scale4 = Conv3d(16, 32, 2, norm)
        self.scale4_same = Conv3d(32, 32, 1, norm)
        self.scale8 = Conv3d(32, 64, 2, norm)
        self.scale8_same = Conv3d(64, 64, 1, norm)
        self.up4 = Deconv3d(64, 32, norm)
        self.up2 = Deconv3d(32, 16, norm)
        self.up1 = Deconv3d(16, 8, norm)
        self.last = nn.Conv3d(8, 1, 3, padding=1, bias=False)

    def forward(self, volume: Tensor) -> Tensor:
        _, _, d, h, w = volume.shape
        # Three halvings: pad each side to a multiple of 8 by repeating the border, crop at the end.
        pad = [0, -w % 8, 0, -h % 8, 0, -d % 8]
        if max(pad) > 0:
            volume = F.pad(volume, pad, mode="replicate")
        full = self.scale1(volume)
        half = self.scale2(volume)
        quarter = self.scale4(half)
        eighth = self.scale8_same(self.scale8(quarter))
        quarter = self.up4(eighth) + self.scale4_same(quarter)
        half = self.up2(quarter) + self.scale2_same(half)
        full = self.up1(half) + full
        return self.last(full)[:, 0, :d, :h, :w]


class EdgeConv(nn.Module):
    """Mean over neighbours q of ReLU(BN(W2 F_q − W1 F_p)), with W1 F_p before it if `keep_centre`."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, keep_centre: bool, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.keep_centre = keep_centre
        self.c_out = c_out
        self.chunk = CHUNK
        self.w1 = nn.Linear(c_in, c_out, bias=False)
        self.w2 = nn.Linear(c_in, c_out, bias=False)
        self.norm = normalisation(norm, 2 * c_out if keep_centre else c_out, 2)

    def forward(self, points: Tensor, neighbours: Tensor) -> Tensor:  # (P, C), (P, k) → (P, C')
        if self.batch:
            if not self.training:
                return self.evaluate(points, neighbours)
        p, k = neighbours.shape
        centre = self.w1(points)  # (P, C')
        edge = self.w2(points)[neighbours] - centre[:, None]  # (P, k, C')
        if self.keep_centre:
            edge = torch.cat((centre[:, None].expand(p, k, self.c_out), edge), dim=2)
        normed = self.norm(edge.permute(2, 0, 1)[None])  # (1, C', P, k)
        return F.relu(normed)[0].mean(dim=2).t()

    def evaluate(self, points: Tensor, neighbours: Tensor) -> Tensor:
        n, c = self.norm, self.c_out
        scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
        centre = F.linear(points, self.w1.weight)
        edge = F.linear(points, self.w2.weight * scale[-c:, None])  # (P, C'), times scale
        offset = centre * scale[-c:] - shift[-c:]
        out = torch.empty((points.shape[0], scale.shape[0]), dtype=points.dtype, device=points.device)
        if self.keep_centre:
            out[:, :c] = F.relu(centre * scale[:c] + shift[:c])
        for start in range(0, points.shape[0], self.chunk):
            near = neighbours[start : start + self.chunk]
            gathered = edge.index_select(0, near.flatten()).view(near.shape[0], near.shape[1], c)
            gathered = gathered.sub_(offset[start : start + self.chunk, None]).relu_()
            out[start : start + self.chunk, scale.shape[0] - c :] = gathered.mean(dim=1)
        return out


class FlowNet(nn.Module):
    """PointFlow (section 3.4): features (P, C) and neighbours (P, k) to one score a point."""

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        self.edge1 = EdgeConv(channels, 32, False, norm)
        self.edge2 = EdgeConv(32, 32, True, norm)
        self.edge3 = EdgeConv(64, 64, True, norm)
        self.mlp = nn.Sequential(Conv1d(224, 64, norm), Conv1d(64, 64, norm), Conv1d(64, 16, norm))
        self.last = nn.Conv1d(16, 1, 1, bias=False)

    def forward(self, features: Tensor, neighbours: Tensor) -> Tensor:
        first = self.edge1(features, neighbours)
        second = self.edge2(first, neighbours)
        third = self.edge3(second, neighbours)
        joined = torch.cat((first, second, third), dim=1)  # (P, 32 + 64 + 128)
        return self.last(self.mlp(joined.t()[None]))[0, 0]


class VaPointMvsNet(nn.Module):
    """The whole network with one of the six aggregations of figure 3."""

    pairwise: Final[bool]  # vis-avg, vis-max: views are related to the reference one by one
    weighted: Final[bool]  # vis-var: views are weighted by what they see

    def __init__(self, aggregation: str = "vis-max", norm: str = "batch") -> None:
        super().__init__()
        if aggregation not in AGGREGATIONS:
            raise ValueError(f"aggregation must be one of {AGGREGATIONS}, not {aggregation!r}")
        self.pairwise = aggregation in ("vis-avg", "vis-max")
        self.weighted = aggregation == "vis-var"
        self.about = json.dumps(
            {
                "contract": 1,
                "name": f"va-point-mvsnet {aggregation}",
                "aggregation": aggregation,
                "neighbours": NEIGHBOURS,
                "hypotheses": HYPOTHESES,
                "flow_layers": 3,
                "planes": 96,
                "iterations": [{"scale": 8, "step": 1.0}, {"scale": 4, "step": 0.75}, {"scale": 2, "step": 0.15}],
                "licence": "MIT OR Apache-2.0",
                "trained_on": "nothing: random weights",
                "scores": {},
            }
        )
        flow_in = sum(FLOW_CHANNELS)
        self.coarse_images = ImageNet(norm)
        self.flow_images = ImageNet(norm)
        self.volume = VolumeNet(64, norm)
        self.flow_net = FlowNet((64 if self.pairwise else flow_in) + POSITION_CHANNELS, norm)
        if self.pairwise:
            self.pair_coarse = mlp2d((128, 128, 128, 64), norm)
            self.pair_flow = nn.Sequential(Conv1d(2 * flow_in, 128, norm), Conv1d(128, 128, norm), Conv1d(128, 64, norm))
        if self.weighted:
            self.pair_visibility = mlp2d((129, 128, 128, 64), norm)
            self.visibility_head = nn.Sequential(mlp2d((64, 64, 16, 4), norm), nn.Conv2d(4, 1, 1), nn.Sigmoid())

    @torch.jit.export
    def manifest(self) -> str:
        return self.about

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        return self.coarse_images(images)[2]

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.flow_images(images)

    @torch.jit.export
    def relate(self, ref: Tensor, src: Tensor, depth: Tensor) -> Tensor:
        pair = torch.cat((ref.expand_as(src), src), dim=1)  # (D, 2C, h, w)
        if self.pairwise:
            return self.pair_coarse(pair)
        if self.weighted:
            plane = depth[:, None, None, None].expand(-1, 1, src.shape[2], src.shape[3])
            return self.pair_visibility(torch.cat((pair, plane), dim=1))
        raise RuntimeError("this aggregation relates no pairs of views")

    @torch.jit.export
    def visibility(self, pooled: Tensor) -> Tensor:
        if self.weighted:
            return self.visibility_head(pooled)
        raise RuntimeError("only vis-var has visibility masks")

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        return self.volume(volume)

    @torch.jit.export
    def relate_flow(self, ref: Tensor, src: Tensor) -> Tensor:
        if self.pairwise:
            return self.pair_flow(torch.cat((ref, src), dim=1))
        raise RuntimeError("this aggregation relates no pairs of views")

    @torch.jit.export
    def flow(self, features: Tensor, neighbours: Tensor) -> Tensor:
        scores = [self.flow_net(features[b].t(), neighbours[b]) for b in range(features.shape[0])]
        return torch.stack(scores)


def mlp2d(channels: tuple[int, ...], norm: str) -> nn.Sequential:
    """A shared MLP over pixels."""
    return nn.Sequential(*(Conv2d(a, b, 1, 1, norm) for a, b in zip(channels, channels[1:])))
