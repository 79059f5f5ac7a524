"""vis-corr: a light network with the same contract and the paper's visibility-aware aggregation, without PointFlow.

Views are compared by group-wise correlation (Guo et al., CVPR 2019), which is the mean product of a few channels of
the reference and source features, instead of by an MLP for every pair of views and every plane. Each source view is
weighted per pixel by a learned visibility, and the weighted mean of the correlations goes into one small 3D U-Net. One
pyramid gives the features. Correlation and weighted mean are in the Rust crates `vamvs-net`, which trains it, and `vamvs-corr`.

As a cascade (Gu et al., CVPR 2020) the network sees a photograph twice: at half its size, to sweep the whole depth range
at a stride of 8, and as it is, to sweep a few planes around that depth at a stride of 4. Both volumes have cells of the same
shape, so both U-Nets start from the same weights. It also tells for each pixel how likely there is a surface to be measured.
"""

import json
from typing import Final

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from layers import Conv2d, Conv3d, Deconv3d, conv3d, normalised, to_one_channel
from va_point_mvsnet import padded

GROUP = 4  # channels in a group
HALF, QUARTER, EIGHTH = 16, 32, 32  # channels of the features at 1/2, 1/4, 1/8
STRIDES = (4, 8)  # strides of the coarse features
WIDTHS = (8, 16, 32, 64)  # channels of the volume at full resolution, 1/2, 1/4, 1/8
CASCADE_PLANES, CASCADE_STEP = 8, 0.5  # planes of the second volume, and their distance in planes of the first
EVIDENCE = 6  # channels of what the volumes tell of a surface
REACH = 4.0  # planes between two depths beyond which they are just different
SLAB = 16  # planes that go through the first and the last layers at once


def enlarged(x: Tensor) -> Tensor:
    """Bilinear upsampling by 2 that keeps the positions of pixel centres."""
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def doubled(x: Tensor) -> Tensor:
    """Each pixel twice in both directions."""
    return F.interpolate(x, scale_factor=2.0, mode="nearest")


def around(x: Tensor) -> list[Tensor]:
    """An image and its eight shifts by one pixel, in rows, with the border repeated: nine images of its shape."""
    h, w = x.shape[2], x.shape[3]
    wide = F.pad(x, [1, 1, 1, 1], mode="replicate")
    return [wide[:, :, k // 3 : k // 3 + h, k % 3 : k % 3 + w] for k in range(9)]


class Even(nn.Module):
    """A convolution that halves an image. Odd sides are first made even by repeating the last row or column."""

    def __init__(self, c_in: int, c_out: int, norm: str) -> None:
        super().__init__()
        self.conv = Conv2d(c_in, c_out, 4, 2, norm)

    def forward(self, x: Tensor) -> Tensor:
        h, w = x.shape[2], x.shape[3]
        if h % 2 + w % 2 > 0:
            x = F.pad(x, [0, w % 2, 0, h % 2], mode="replicate")
        return self.conv(x)


class Pyramid(nn.Module):
    """A feature pyramid network: features at 1/2, 1/4 and 1/8, with context from levels down to 1/32.
    (B, 3, H, W), H and W multiples of 8 → (B, 16, H/2, W/2), (B, 32, H/4, W/4), (B, 32, H/8, W/8)."""

    def __init__(self, norm: str) -> None:
        super().__init__()
        self.down1 = nn.Sequential(Conv2d(3, 16, 4, 2, norm), Conv2d(16, 16, 3, 1, norm))
        self.down2 = nn.Sequential(Conv2d(16, 32, 4, 2, norm), Conv2d(32, 32, 3, 1, norm), Conv2d(32, 32, 3, 1, norm))
        self.down3 = nn.Sequential(Conv2d(32, 48, 4, 2, norm), Conv2d(48, 48, 3, 1, norm), Conv2d(48, 48, 3, 1, norm))
        self.down4 = nn.Sequential(Even(48, 64, norm), Conv2d(64, 64, 3, 1, norm))
        self.down5 = nn.Sequential(Even(64, 64, norm), Conv2d(64, 64, 3, 1, norm))
        self.up4 = nn.Conv2d(64, 64, 1)
        self.up3, self.side3 = nn.Conv2d(64, EIGHTH, 1), nn.Conv2d(48, EIGHTH, 1, bias=False)
        self.up2, self.side2 = nn.Conv2d(EIGHTH, QUARTER, 1), nn.Conv2d(32, QUARTER, 1, bias=False)
        self.up1, self.side1 = nn.Conv2d(QUARTER, HALF, 1), nn.Conv2d(16, HALF, 1, bias=False)
        self.out3 = nn.Conv2d(EIGHTH, EIGHTH, 3, padding=1, bias=False)
        self.out2 = nn.Conv2d(QUARTER, QUARTER, 3, padding=1, bias=False)
        self.out1 = nn.Conv2d(HALF, HALF, 3, padding=1, bias=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        half = self.down1(normalised(images))
        quarter, eighth = self.coarser(half)
        half = enlarged(self.up1(quarter)) + self.side1(half)
        return self.out1(half), self.out2(quarter), self.out3(eighth)

    def one(self, images: Tensor, stride: int) -> Tensor:
        """The features at 1/4 or 1/8 alone."""
        quarter, eighth = self.coarser(self.down1(normalised(images)))
        return self.out2(quarter) if stride == 4 else self.out3(eighth)

    def coarser(self, half: Tensor) -> tuple[Tensor, Tensor]:
        """From the first level at 1/2 to the features at 1/4 and 1/8, before their last convolutions."""
        quarter = self.down2(half)
        eighth = self.down3(quarter)
        sixteenth = self.down4(eighth)
        far = enlarged(self.up4(self.down5(sixteenth)))
        sixteenth = F.relu(sixteenth + far[:, :, : sixteenth.shape[2], : sixteenth.shape[3]])
        wide = enlarged(self.up3(sixteenth))[:, :, : eighth.shape[2], : eighth.shape[3]]
        eighth = wide + self.side3(eighth)
        return enlarged(self.up2(eighth)) + self.side2(quarter), eighth


def planes_of(volume: Tensor, first: int, end: int) -> Tensor:
    """The planes `first..end` of `padded(volume)`, which is never held as a whole."""
    d, h, w = volume.shape[2], volume.shape[3], volume.shape[4]
    inside = volume[:, :, min(first, d - 1) : min(end, d)]
    pad = [0, -w % 8, 0, -h % 8, 0, end - first - inside.shape[2]]
    return F.pad(inside, pad, mode="replicate") if max(pad) > 0 else inside


class Gates(nn.Module):
    """Factors for the channels of the volume, from the features of the reference view, so that regularisation follows
    what the photograph shows (guided cost-volume excitation, Bangunharcana et al., IROS 2021): (B, C, h, w) → factors
    (B, c, 1, h', w') from 0 to 2, at full resolution, 1/2, 1/4, 1/8, and once more at 1/2 and 1/4. h' and w' are
    those of the padded volume. In an untrained network all are 1."""

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        a, b, c, d = 16, 32, 48, 64
        self.side1 = Conv2d(channels, a, 3, 1, norm)
        self.side2 = Conv2d(channels, b, 4, 2, norm)
        self.side4 = Conv2d(b, c, 4, 2, norm)
        self.side8 = nn.Sequential(Conv2d(c, d, 4, 2, norm), Conv2d(d, d, 3, 1, norm))
        self.up4, self.up2, self.up1 = nn.Conv2d(d, c, 1), nn.Conv2d(c, b, 1), nn.Conv2d(b, a, 1)
        levels = zip((a, b, c, d, b, c), (*WIDTHS, *WIDTHS[1:3]))
        self.heads = nn.ModuleList([nn.Conv2d(given, wanted, 1) for given, wanted in levels])
        for head in self.heads:
            nn.init.zeros_(head.weight)
            nn.init.zeros_(head.bias)

    def forward(self, reference: Tensor) -> list[Tensor]:
        h, w = reference.shape[2], reference.shape[3]
        reference = F.pad(reference, [0, -w % 8, 0, -h % 8], mode="replicate")
        half = self.side2(reference)
        quarter = self.side4(half)
        eighth = self.side8(quarter)
        quarter = F.relu(quarter + enlarged(self.up4(eighth)))
        half = F.relu(half + enlarged(self.up2(quarter)))
        full = F.relu(self.side1(reference) + enlarged(self.up1(half)))
        levels = [full, half, quarter, eighth, half, quarter]
        return [2.0 * torch.sigmoid(head(levels[i]))[:, :, None] for i, head in enumerate(self.heads)]


class Residual3d(nn.Module):
    """Two 3×3×3 convolutions beside the identity: (B, C, D, H, W) → the same shape. Untrained it is the identity."""

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        self.first = Conv3d(channels, channels, 1, norm)
        self.second = nn.Conv3d(channels, channels, 3, padding=1, bias=False)
        nn.init.zeros_(self.second.weight)

    def forward(self, x: Tensor) -> Tensor:
        return x + conv3d(self.first(x), self.second.weight, None, 1, [1, 1, 1])


class SmallVolumeNet(nn.Module):
    """Cost-volume regularisation: a 3D U-Net most of which works at half the resolution and below. Of the volume and
    the features of the reference view: (1, C, D, h, w), (1, C', h, w) → (1, D, h, w)."""

    def __init__(self, channels: int, context: int, norm: str) -> None:
        super().__init__()
        a, b, c, d = WIDTHS
        self.slab = SLAB
        self.gates = Gates(context, norm)
        self.same = nn.Conv3d(channels, a, 1)
        self.scale2 = Conv3d(channels, b, 2, norm)
        self.scale2_same = Conv3d(b, b, 1, norm)
        self.scale4 = Conv3d(b, c, 2, norm)
        self.scale4_same = Conv3d(c, c, 1, norm)
        self.scale8 = Conv3d(c, d, 2, norm)
        self.scale8_same = Conv3d(d, d, 1, norm)
        self.deep4 = Residual3d(c, norm)
        self.deep8 = nn.Sequential(Residual3d(d, norm), Residual3d(d, norm))
        self.up4 = Deconv3d(d, c, norm)
        self.up2 = Deconv3d(c, b, norm)
        self.up1 = Deconv3d(b, a, norm)
        self.last = nn.Conv3d(a, 1, 3, padding=1, bias=False)

    def forward(self, volume: Tensor, reference: Tensor) -> Tensor:
        _, _, d, h, w = volume.shape
        gates = self.gates(reference)
        if self.training or not self.scale2.batch:  # other normalisations than folded ones need the whole volume
            volume = padded(volume)
            half = self.half(self.scale2(volume), gates)
            full = (self.up1(half) + F.relu(self.beside(volume))) * gates[0]
            return self.last(full)[:, 0, :d, :h, :w]
        planes = d + -d % 8
        firsts = range(0, planes, self.slab)
        halves = [self.halved(volume, first, min(first + self.slab, planes)) for first in firsts]
        half = self.half(torch.cat(halves, dim=2), gates)
        slabs = [self.costs(volume, half, gates[0], first, min(first + self.slab, planes)) for first in firsts]
        return torch.cat(slabs, dim=2)[:, 0, :d, :h, :w]

    def half(self, half: Tensor, gates: list[Tensor]) -> Tensor:
        """The layers at half the resolution and below, on the output of `scale2`."""
        half = self.scale2_same(half) * gates[1]
        quarter = self.deep4(self.scale4_same(self.scale4(half)) * gates[2])
        eighth = self.deep8(self.scale8_same(self.scale8(quarter)) * gates[3])
        quarter = (self.up4(eighth) + quarter) * gates[5]
        return (self.up2(quarter) + half) * gates[4]

    def halved(self, volume: Tensor, first: int, end: int) -> Tensor:
        """`scale2` of the planes `first..end` of a padded volume; both are even. It needs one plane before as a halo."""
        weight, shift = self.scale2.folded()
        planes = planes_of(volume, max(first - 1, 0), end)
        if first == 0:
            planes = F.pad(planes, [0, 0, 0, 0, 1, 0])
        return conv3d(planes, weight, shift, 2, [0, 1, 1]).relu_()

    def beside(self, volume: Tensor) -> Tensor:
        """The skip connection at full resolution, before its ReLU, of one volume (1, C, D, h, w): the 1×1×1 convolution
        `same` as a matrix product, whose result has the layout of the layers that it is added to."""
        _, c, d, h, w = volume.shape
        bias = self.same.bias
        assert bias is not None
        product = torch.addmm(bias[:, None], self.same.weight.view(-1, c), volume.reshape(c, -1))
        return product.view(1, -1, d, h, w)

    def costs(self, volume: Tensor, half: Tensor, gate: Tensor, first: int, end: int) -> Tensor:
        """The last layers for the planes `first..end` of the padded volume only, so that their input at full resolution is never held as a
        whole. The last convolution needs one plane before and one after as a halo."""
        planes = volume.shape[2] + -volume.shape[2] % 8
        low, high = max(first - 1, 0), min(end + 1, planes)
        # Plane p of the upsampled volume is computed from plane p/2 or, if p is odd, (p − 1)/2 and (p + 1)/2.
        low_half, high_half = low // 2, min(high // 2 + 1, planes // 2)
        up = self.up1(half[:, :, low_half:high_half])[:, :, low - 2 * low_half : high - 2 * low_half]
        full = (self.beside(planes_of(volume, low, high)).relu_() + up).mul_(gate)
        if first == 0 or end == planes:
            full = F.pad(full, [0, 0, 0, 0, 1 if first == 0 else 0, 1 if end == planes else 0])
        return to_one_channel(full, self.last.weight)


class Surface(nn.Module):
    """How likely a pixel shows a surface inside the depth range, and not sky or what lies beyond: from what the volumes
    tell (B, 6, h, w) and the features of the reference view (B, C, h, w) → (B, 1, h, w) in [0, 1]. Untrained it says 0.98
    everywhere."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.look = nn.Conv2d(channels, 16, 3, padding=1)
        self.weigh = nn.Conv2d(16 + EVIDENCE, 16, 3, padding=1)
        self.wide = nn.Conv2d(16, 16, 3, padding=2, dilation=2)
        self.judge = nn.Conv2d(16, 1, 1)
        nn.init.zeros_(self.judge.weight)
        assert self.judge.bias is not None
        nn.init.constant_(self.judge.bias, 4.0)

    def forward(self, evidence: Tensor, reference: Tensor) -> Tensor:
        x = torch.cat([F.relu(self.look(reference)), evidence], dim=1)
        x = F.relu(self.weigh(x))
        return torch.sigmoid(self.judge(x + F.relu(self.wide(x))))


class Enlarge(nn.Module):
    """Which of the nine coarse pixels around a pixel is of the same surface (as in RAFT, Teed and Deng, ECCV 2020): the
    coarse depth in plane coordinates (1, 1, h, w) and the features of the reference view at both resolutions,
    (1, C, h, w) and (1, C, 2h, 2w) → shares (1, 9, 2h, 2w), rows first, whose sum is 1. Untrained they are those of bilinear
    interpolation."""

    bilinear: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.reach = REACH
        self.look = nn.Conv2d(channels, 16, 3, padding=1)
        self.weigh = nn.Conv2d(16 + 3 * 9, 32, 1)
        self.choose = nn.Conv2d(32, 9, 1)
        nn.init.zeros_(self.choose.weight)
        assert self.choose.bias is not None
        nn.init.zeros_(self.choose.bias)
        side = torch.tensor([[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]])  # of the first and the second pixel of two
        shares = side[:, None, :, None] * side[None, :, None, :]
        self.register_buffer("bilinear", torch.log(shares + 0.01).permute(2, 3, 0, 1).reshape(1, 9, 2, 2))

    def forward(self, depth: Tensor, coarse: Tensor, reference: Tensor) -> Tensor:
        h, w = depth.shape[2], depth.shape[3]
        depths = around(depth)
        steps = torch.cat([(other - depth).clamp(-self.reach, self.reach) / self.reach for other in depths], dim=1)
        fine = F.normalize(reference, dim=1)
        others = around(F.normalize(coarse, dim=1))
        alike = torch.cat([(fine * doubled(other)).sum(1, keepdim=True) for other in others], dim=1)
        bilinear = self.bilinear.repeat(1, 1, h, w)
        x = torch.cat([F.relu(self.look(reference)), doubled(steps), alike, bilinear], dim=1)
        return torch.softmax(bilinear + self.choose(F.relu(self.weigh(x))), dim=1)


class VisCorr(nn.Module):
    """The network; `stride` is that of the coarse features and of the coarse depth map. As a `cascade` it has a second
    volume."""

    stride: Final[int]
    cascade: Final[bool]

    def __init__(self, norm: str = "batch", stride: int = 4, cascade: bool = False) -> None:
        super().__init__()
        if stride not in STRIDES:
            raise ValueError(f"the stride must be one of {STRIDES}, not {stride}")
        if cascade and stride != 4:
            raise ValueError("a cascade ends at a stride of 4")
        self.stride = stride
        self.cascade = cascade
        of_cascade = {"cascade": {"planes": CASCADE_PLANES, "step": CASCADE_STEP}, "plane_step": 8.0} if cascade else {}
        self.about = json.dumps(
            {
                "contract": 1,
                "name": "vis-corr",
                "aggregation": "vis-corr",
                "group": GROUP,
                "feature_stride": stride,
                "coarse_stride": stride,
                "coarse_alone": True,
                "context": True,
                "window": 2,
                "neighbours": 16,
                "hypotheses": 2,
                "flow_layers": 3,
                "planes": 48,
                "iterations": [],
                "licence": "MIT OR Apache-2.0",
                "trained_on": "nothing: random weights",
                "scores": {},
                **of_cascade,
            }
        )
        coarse = QUARTER if stride == 4 else EIGHTH
        groups = coarse // GROUP
        self.pyramid = Pyramid(norm)
        self.volume = SmallVolumeNet(groups, coarse, norm)
        if cascade:
            self.fine = SmallVolumeNet(groups, coarse, norm)
            self.surface_net = Surface(coarse)
            self.enlarge_net = Enlarge(coarse)
        self.seen = nn.Sequential(Conv2d(2 * groups, 16, 3, 1, norm), Conv2d(16, 16, 3, 1, norm), nn.Conv2d(16, 1, 1))

    @torch.jit.export
    def manifest(self) -> str:
        return self.about

    @torch.jit.export
    def set_manifest(self, about: str) -> None:
        self.about = about

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        return self.pyramid.one(images, self.stride)

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.pyramid(images)

    @torch.jit.export
    def relate(self, ref: Tensor, src: Tensor, depth: Tensor) -> Tensor:
        raise RuntimeError("vis-corr correlates pairs of views, it relates none")

    @torch.jit.export
    def visibility(self, pooled: Tensor) -> Tensor:
        return torch.sigmoid(self.seen(pooled))

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        raise RuntimeError("vis-corr regularises a volume in the context of the reference view")

    @torch.jit.export
    def regularize_in_context(self, volume: Tensor, reference: Tensor) -> Tensor:
        return self.volume(volume, reference)

    @torch.jit.export
    def regularize_fine(self, volume: Tensor, reference: Tensor) -> Tensor:
        if self.cascade:
            return self.fine(volume, reference)
        raise RuntimeError("this network is no cascade")

    @torch.jit.export
    def enlarge(self, depth: Tensor, coarse: Tensor, reference: Tensor) -> Tensor:
        if self.cascade:
            return self.enlarge_net(depth, coarse, reference)
        raise RuntimeError("this network is no cascade")

    @torch.jit.export
    def surface(self, evidence: Tensor, reference: Tensor) -> Tensor:
        if self.cascade:
            return self.surface_net(evidence, reference)
        raise RuntimeError("this network is no cascade")
