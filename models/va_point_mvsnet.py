"""The network of Chen et al., "Visibility-Aware Point-Based Multi-View Stereo Network" (TPAMI 2020).

Layer sizes are those of the authors' implementation, except for the convolutions that halve the image. They are
4×4 instead of 5×5, so that a feature is centred on the pixels that it covers. With `kernel` 5, as the authors have it,
features are shifted by 0.5, 1.5 and 3.5 image pixels at the three levels, which the manifest says. The module contains the
learned part. The geometry between its methods (warping, lifting, neighbours, the reduction over views) is in the Rust
crate `vamvs-net`. README.md in this folder is the contract between both.
"""

import json
from typing import Final, Optional

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from layers import Conv1d, Conv2d, Conv3d, Deconv3d, Pair1d, normalisation, normalised, scale_shift
from matcher import GradientMatcher

AGGREGATIONS = ("avg", "max", "var", "vis-avg", "vis-max", "vis-var")
KERNELS = (4, 5)  # of the convolutions that halve the image
NEIGHBOURS = 16
HYPOTHESES = 2  # hypotheses to each side of a point (m)
STEPS = (1.0, 0.75, 0.15)  # distances between hypotheses in the three flow iterations, in plane distances (s)
POSITION_CHANNELS = 24  # x, y, z, repeated 8 times
FLOW_CHANNELS = (16, 32, 64)
CHUNK = 4096  # points whose neighbours are gathered at once, so that they stay in the cache
PAIRS = 8192  # pairs, or points, that go through a shared MLP at once, for the same reason


class ImageNet(nn.Module):
    """Image pyramid (section 3.1): (B, 3, H, W) → 16 channels at 1/2, 32 at 1/4, 64 at 1/8, each divided by `thin`."""

    def __init__(self, norm: str, thin: int, kernel: int) -> None:
        super().__init__()
        a, b, c, d = (channels // thin for channels in (8, *FLOW_CHANNELS))
        self.level0 = nn.Sequential(Conv2d(3, a, 3, 1, norm), Conv2d(a, a, 3, 1, norm))
        self.level1 = nn.Sequential(Conv2d(a, b, kernel, 2, norm), Conv2d(b, b, 3, 1, norm), Conv2d(b, b, 3, 1, norm))
        self.level2 = nn.Sequential(Conv2d(b, c, kernel, 2, norm), Conv2d(c, c, 3, 1, norm), Conv2d(c, c, 3, 1, norm))
        self.level3 = nn.Sequential(Conv2d(c, d, kernel, 2, norm), Conv2d(d, d, 3, 1, norm))
        self.last = nn.Conv2d(d, d, 3, padding=1, bias=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        half = self.level1(self.level0(normalised(images)))
        quarter = self.level2(half)
        eighth = self.last(self.level3(quarter))
        return half.contiguous(), quarter.contiguous(), eighth.contiguous()


class VolumeNet(nn.Module):
    """Cost-volume regularisation (section 3.2), a 3D U-Net: (B, C, D, h, w) → (B, D, h, w)."""

    def __init__(self, channels: int, norm: str, thin: int) -> None:
        super().__init__()
        a, b, c, d = (width // thin for width in (8, 16, 32, 64))
        self.scale1 = Conv3d(channels, a, 1, norm)
        self.scale2 = Conv3d(channels, b, 2, norm)
        self.scale2_same = Conv3d(b, b, 1, norm)
        self.scale4 = Conv3d(b, c, 2, norm)
        self.scale4_same = Conv3d(c, c, 1, norm)
        self.scale8 = Conv3d(c, d, 2, norm)
        self.scale8_same = Conv3d(d, d, 1, norm)
        self.up4 = Deconv3d(d, c, norm)
        self.up2 = Deconv3d(c, b, norm)
        self.up1 = Deconv3d(b, a, norm)
        self.last = nn.Conv3d(a, 1, 3, padding=1, bias=False)

    def forward(self, volume: Tensor) -> Tensor:
        _, _, d, h, w = volume.shape
        volume = padded(volume)
        return self.costs(self.scale1(volume), self.scale2(volume))[:, 0, :d, :h, :w]

    def costs(self, full: Tensor, half: Tensor) -> Tensor:
        quarter = self.scale4(half)
        eighth = self.scale8_same(self.scale8(quarter))
        quarter = self.up4(eighth) + self.scale4_same(quarter)
        half = self.up2(quarter) + self.scale2_same(half)
        return self.last(self.up1(half) + full)

    def slab(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        """The first layers before their shift and ReLU, on D planes with one more before and one after, so that the
        volume is never held as a whole: (1, C, D + 2, h, w), D even → (1, a, D, h', w') at full and
        (1, b, D/2, h'/2, w'/2) at half resolution. C may be less than the layers' input channels: `slabs` adds the
        contribution of the last ones."""
        weight1, _ = self.scale1.folded()
        weight2, _ = self.scale2.folded()
        c, h, w = planes.shape[1], planes.shape[3], planes.shape[4]
        if h % 8 + w % 8 > 0:
            planes = F.pad(planes, [0, -w % 8, 0, -h % 8, 0, 0], mode="replicate")
        # Made contiguous, because a slice of a folded weight is not.
        full = F.conv3d(planes, weight1[:, :c].contiguous(), None, 1, [0, 1, 1])
        return full, F.conv3d(planes, weight2[:, :c].contiguous(), None, 2, [0, 1, 1])

    def slabs(self, full: Tensor, half: Tensor, last: Tensor) -> Tensor:
        """The remaining layers, on the outputs of `slab` for all planes, (1, a, D', h', w') and
        (1, b, D'/2, h'/2, w'/2), and the last channels of the volume, (1, C, D, h, w), of which there may be none →
        costs (1, D, h, w). Overwrites `full` and `half`."""
        weight1, shift1 = self.scale1.folded()
        weight2, shift2 = self.scale2.folded()
        _, c, d, h, w = last.shape
        if c > 0:
            last = padded(last)
            full.add_(F.conv3d(last, weight1[:, -c:].contiguous(), None, 1, 1))
            half.add_(F.conv3d(last, weight2[:, -c:].contiguous(), None, 2, 1))
        full = full.add_(shift1[:, None, None, None]).relu_()
        half = half.add_(shift2[:, None, None, None]).relu_()
        quarter = self.scale4(half)
        eighth = self.scale8_same(self.scale8(quarter))
        quarter = self.up4(eighth).add_(self.scale4_same(quarter))
        half = self.up2(quarter).add_(self.scale2_same(half))
        return self.last(full.add_(self.up1(half)))[:, 0, :d, :h, :w]


def padded(volume: Tensor) -> Tensor:
    """A volume (B, C, D, h, w) with D, h, w padded to multiples of 8, for three halvings, by repeating the border."""
    _, _, d, h, w = volume.shape
    pad = [0, -w % 8, 0, -h % 8, 0, -d % 8]
    return F.pad(volume, pad, mode="replicate") if max(pad) > 0 else volume


class EdgeConv(nn.Module):
    """Edge convolution at point p: the mean over neighbours q of ReLU(BN(W2 F_q − W1 F_p)). With `keep_centre`, the
    channels of ReLU(BN(W1 F_p)) come before it."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, keep_centre: bool, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.keep_centre = keep_centre
        self.c_out = c_out
        self.chunk = CHUNK
        self.w1 = nn.Linear(c_in, c_out, bias=False)
        self.w2 = nn.Linear(c_in, c_out, bias=False)
        self.norm = normalisation(norm, 2 * c_out if keep_centre else c_out, 2, True)

    def forward(self, points: Tensor, neighbours: Tensor) -> Tensor:  # (P, C), (P, k) → (P, C')
        if self.batch:
            if not self.training:
                return self.evaluate(points, neighbours)
        p, k = neighbours.shape
        centre = self.w1(points)  # (P, C')
        near = self.w2(points).index_select(0, neighbours.flatten()).view(p, k, self.c_out)
        edge = near - centre[:, None]  # (P, k, C')
        if self.batch:
            return self.train_batch(centre, edge)
        if self.keep_centre:
            edge = torch.cat((centre[:, None].expand(p, k, self.c_out), edge), dim=2)
        normed = self.norm(edge.permute(2, 0, 1)[None])  # (1, C', P, k)
        return F.relu(normed)[0].mean(dim=2).t()

    def train_batch(self, centre: Tensor, edge: Tensor) -> Tensor:
        """BatchNorm with the statistics of the current data. It works channel by channel, so W1 F_p, which is the same
        for all k neighbours, is not repeated."""
        n, c = self.norm, self.c_out
        mean, var = n.running_mean, n.running_var
        assert mean is not None and var is not None
        w, b = n.weight, n.bias
        flat = F.batch_norm(edge.flatten(0, 1), mean[-c:], var[-c:], w[-c:], b[-c:], True)
        out = F.relu(flat).view(edge.shape).mean(dim=1)
        if self.keep_centre:
            first = F.relu(F.batch_norm(centre, mean[:c], var[:c], w[:c], b[:c], True))
            out = torch.cat((first, out), dim=1)
        return out

    def folded(self) -> list[Tensor]:
        """With the BatchNorm of evaluation mode folded in: weight and shift of what each point keeps of itself (no rows
        without `keep_centre`), weight and shift of what is subtracted from its neighbours, and the neighbours' weight."""
        if self.batch:
            n, c = self.norm, self.c_out
            scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
            w1, w2, kept = self.w1.weight, self.w2.weight, scale.shape[0] - c
            own = w1[:kept] * scale[:kept, None]
            return [own, shift[:kept], w1 * scale[-c:, None], -shift[-c:], w2 * scale[-c:, None]]
        raise RuntimeError("only a BatchNorm can be folded")

    def evaluate(self, points: Tensor, neighbours: Tensor) -> Tensor:
        own_weight, own_shift, weight, shift, near_weight = self.folded()
        c = self.c_out
        edge = F.linear(points, near_weight)
        offset = F.linear(points, weight, shift)
        kept = own_weight.shape[0]
        out = torch.empty((points.shape[0], kept + c), dtype=points.dtype, device=points.device)
        if self.keep_centre:
            out[:, :kept] = F.relu(F.linear(points, own_weight, own_shift))
        for start in range(0, points.shape[0], self.chunk):
            near = neighbours[start : start + self.chunk]
            gathered = edge.index_select(0, near.flatten()).view(near.shape[0], near.shape[1], c)
            gathered = gathered.sub_(offset[start : start + self.chunk, None]).relu_()
            out[start : start + self.chunk, kept:] = gathered.mean(dim=1)
        return out


class FlowNet(nn.Module):
    """PointFlow (section 3.4): features (P, C) and neighbours (P, k) → one score per point, (P)."""

    def __init__(self, channels: int, norm: str, thin: int) -> None:
        super().__init__()
        a, b, c = 16 // thin, 32 // thin, 64 // thin
        self.chunk = PAIRS
        self.edge1 = EdgeConv(channels, b, False, norm)
        self.edge2 = EdgeConv(b, b, True, norm)
        self.edge3 = EdgeConv(c, c, True, norm)
        self.mlp = nn.Sequential(Conv1d(b + c + 2 * c, c, norm), Conv1d(c, c, norm), Conv1d(c, a, norm))
        self.last = nn.Conv1d(a, 1, 1, bias=False)

    def forward(self, features: Tensor, neighbours: Tensor) -> Tensor:
        first = self.edge1(features, neighbours)
        second = self.edge2(first, neighbours)
        third = self.edge3(second, neighbours)
        if self.training or features.requires_grad or features.is_cuda:
            return self.scores(first, second, third)
        out = torch.empty(features.shape[0], dtype=features.dtype)
        for start in range(0, features.shape[0], self.chunk):
            end = start + self.chunk
            out[start:end] = self.scores(first[start:end], second[start:end], third[start:end])
        return out

    def folded(self) -> dict[str, list[Tensor]]:
        """The folded layers, which the kernels of vamvs run on the CPU."""
        mlp: list[Tensor] = []
        for layer in self.mlp:
            mlp.extend(layer.folded())
        last = self.last.weight[:, :, 0]
        mlp.extend([last, torch.zeros_like(last[:, 0])])
        edges = self.edge1.folded() + self.edge2.folded() + self.edge3.folded()
        return {"flow_edges": edges, "flow_scores": mlp}

    def scores(self, first: Tensor, second: Tensor, third: Tensor) -> Tensor:
        joined = torch.cat((first, second, third), dim=1)  # (P, 32 + 64 + 128)
        return torch.mm(self.last.weight[:, :, 0], self.mlp(joined.t()))[0]


class PairMlp(nn.Module):
    """A shared MLP on pairs of features [a, b]: a (1, A, P), b (B, C, P) → (B, C', P)."""

    def __init__(self, c_a: int, c_b: int, channels: tuple[int, int, int], norm: str) -> None:
        super().__init__()
        first, second, last = channels
        self.last = last
        self.chunk = PAIRS
        self.pair = Pair1d(c_a, c_b, first, norm)
        self.rest = nn.Sequential(Conv1d(first, second, norm), Conv1d(second, last, norm))

    def folded(self) -> list[Tensor]:
        """Weights and shifts of the layers in turn."""
        layers = self.pair.folded()
        for layer in self.rest:
            layers.extend(layer.folded())
        return layers

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        if self.training or b.requires_grad or b.is_cuda:
            return self.relate(a[0], b)
        views, _, p = b.shape
        out = torch.empty((views, self.last, p), dtype=b.dtype, device=b.device)
        step = max(1, self.chunk // views)
        for start in range(0, p, step):
            end = min(start + step, p)
            out[:, :, start:end] = self.relate(a[0, :, start:end], b[:, :, start:end])
        return out

    def relate(self, a: Tensor, b: Tensor) -> Tensor:
        """All points at once: a (A, P), b (B, C, P) → (B, C', P)."""
        views, c, p = b.shape
        related = self.rest(self.pair(a, b.transpose(0, 1).reshape(c, views * p)))
        return related.view(-1, views, p).transpose(0, 1)


class VaPointMvsNet(nn.Module):
    """The whole network, with one of the six aggregations of figure 3.

    All hidden layers have the paper's number of channels divided by `thin`, which is 1 except for small test networks.
    These options leave out or change a part, for the paper's ablations: `neighbours` of a point (1: only itself),
    `hypotheses` to each side of a point (0: the offset is regressed directly, table 8), `plane_depth` (the plane's
    depth as an input of the visibility, table 3), `image_features` of the points (table 6).

    The last options go beyond the paper. With `matched`, the regularisation of the volume also gets the similarities
    and probabilities of the handcrafted matcher, and its output is added to the matcher's costs. The network then only
    has to learn where the matcher is wrong, which takes far fewer samples. `window`, `completion`, `guide`,
    `coarse_stride` and `flow_sources` are entries of the manifest for the stages around the network: see README.md in
    this folder.
    """

    pairwise: Final[bool]  # vis-avg, vis-max: pair features of the reference and each source view are aggregated
    weighted: Final[bool]  # vis-var: source views are weighted by their visibility
    plane_depth: Final[bool]  # vis-var: the visibility also depends on the plane's depth
    matched: Final[bool]  # the coarse stage also uses the handcrafted matcher

    def __init__(
        self,
        aggregation: str = "vis-max",
        norm: str = "batch",
        thin: int = 1,
        neighbours: int = NEIGHBOURS,
        hypotheses: int = HYPOTHESES,
        plane_depth: bool = True,
        image_features: bool = True,
        matched: bool = False,
        window: Optional[int] = None,
        completion: Optional[tuple[float, float]] = None,
        guide: Optional[float] = None,
        coarse_stride: int = 8,
        steps: tuple[float, float, float] = STEPS,
        flow_sources: Optional[int] = None,
        kernel: int = 4,
    ) -> None:
        super().__init__()
        if aggregation not in AGGREGATIONS:
            raise ValueError(f"aggregation must be one of {AGGREGATIONS}, not {aggregation!r}")
        if matched and aggregation not in ("vis-avg", "vis-max"):
            raise ValueError(f"the handcrafted matcher compares pairs of views, as {aggregation} does not")
        if kernel not in KERNELS:
            raise ValueError(f"the kernel must be one of {KERNELS}, not {kernel}")
        if kernel != 4 and matched:
            raise ValueError("the handcrafted matcher's features are centred, as those of a kernel of 5 are not")
        self.plane_depth = plane_depth
        self.matched = matched
        self.pairwise = aggregation in ("vis-avg", "vis-max")
        self.weighted = aggregation == "vis-var"
        about: dict[str, object] = {
            "contract": 1,
            "name": f"va-point-mvsnet {aggregation}" + (", matched" if matched else ""),
            "aggregation": aggregation,
            "neighbours": neighbours,
            "hypotheses": hypotheses,
            "flow_layers": 3,
            "planes": 96,
            "iterations": [{"scale": scale, "step": step} for scale, step in zip((8, 4, 2), steps)],
            "licence": "MIT OR Apache-2.0",
            "trained_on": "nothing: random weights",
            "scores": {},
        }
        if norm == "batch":
            about["slabs"] = True
            about["layers"] = True
        if matched:
            about["averaged"] = 1
        if window is not None:
            about["window"] = window
        if completion is not None:
            about["completion"] = {"stiffness": completion[0], "power": completion[1]}
        if guide is not None:
            about["guide"] = guide
        if coarse_stride != 8:
            about["coarse_stride"] = coarse_stride
        if kernel == 5:
            about["feature_offsets"] = [0.5, 1.5, 3.5]
        if flow_sources is not None:
            about["flow_sources"] = flow_sources
        self.about = json.dumps(about)
        flow_in = sum(FLOW_CHANNELS) // thin
        wide, out = 128 // thin, 64 // thin
        self.coarse_images = ImageNet(norm, thin, kernel)
        self.flow_images = ImageNet(norm, thin, kernel)
        self.coarse_channels = out
        self.volume = VolumeNet(out + 2 * matched, norm, thin)
        if matched:
            self.matcher = GradientMatcher()
            self.trust = nn.Parameter(torch.tensor(1.0))  # weight of the matcher's costs
        fetched = out if self.pairwise else flow_in
        self.ignored = 0 if image_features else fetched  # the flow ignores this many first channels of a point
        self.flow_net = FlowNet(fetched - self.ignored + POSITION_CHANNELS, norm, thin)
        if self.pairwise:
            self.pair_coarse = PairMlp(out, out, (wide, wide, out), norm)
            self.pair_flow = PairMlp(flow_in, flow_in, (wide, wide, out), norm)
        if self.weighted:
            self.pair_visibility = PairMlp(out, out + plane_depth, (wide, wide, out), norm)
            head = mlp2d((out, out, 16 // thin, 4), norm)
            self.visibility_head = nn.Sequential(head, nn.Conv2d(4, 1, 1), nn.Sigmoid())

    @torch.jit.export
    def manifest(self) -> str:
        return self.about

    @torch.jit.export
    def set_manifest(self, about: str) -> None:
        self.about = about

    @torch.jit.export
    def layers(self) -> dict[str, list[Tensor]]:
        layers = self.flow_net.folded()
        if self.ignored > 0:
            edges = layers["flow_edges"]
            for index in (0, 2, 4):  # the weights of the first edge convolution
                edges[index] = F.pad(edges[index], [self.ignored, 0])
        if self.pairwise:
            layers["relate"] = self.pair_coarse.folded()
            layers["relate_flow"] = self.pair_flow.folded()
        if self.matched:
            layers["relate_ncc"] = [torch.tensor([self.matcher.kernel, self.matcher.noise])]
        return layers

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        learned = self.coarse_images(images)[2]
        if self.matched:
            return torch.cat((learned, self.matcher.cells(images)), dim=1)
        return learned

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.flow_images(images)

    @torch.jit.export
    def relate(self, ref: Tensor, src: Tensor, depth: Tensor) -> Tensor:
        d, _, h, w = src.shape
        if self.pairwise:
            c = self.coarse_channels
            related = self.pair_coarse(ref[:, :c].flatten(2), src[:, :c].flatten(2)).unflatten(2, (h, w))
            if self.matched:
                matches = self.matcher.cell_similarity(ref[:, c:].detach(), src[:, c:].detach())
                related = torch.cat((related, matches), dim=1)
            return related
        if self.weighted:
            seen = src.flatten(2)
            if self.plane_depth:
                seen = torch.cat((seen, depth[:, None, None].expand(d, 1, h * w)), dim=1)
            return self.pair_visibility(ref.flatten(2), seen).unflatten(2, (h, w))
        raise RuntimeError("this aggregation relates no pairs of views")

    @torch.jit.export
    def visibility(self, pooled: Tensor) -> Tensor:
        if self.weighted:
            return self.visibility_head(pooled)
        raise RuntimeError("only vis-var has visibility masks")

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        if self.matched:
            matches = volume[:, self.coarse_channels :].detach()  # mean similarity over the views, (1, 1, D, h, w)
            costs = self.matcher.costs(matches[:, 0])
            likely = torch.softmax(-costs, dim=1)[:, None]
            joined = torch.cat((volume, likely), dim=1)
            return self.volume(joined) + self.trust * costs
        return self.volume(volume)

    @torch.jit.export
    def regularize_slab(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        return self.volume.slab(planes)

    @torch.jit.export
    def regularize_slabs(self, full: Tensor, half: Tensor, averaged: Tensor) -> Tensor:
        if self.matched:
            costs = self.matcher.costs(averaged[:, 0])
            likely = torch.softmax(-costs, dim=1)[:, None]
            return self.volume.slabs(full, half, likely) + self.trust * costs
        return self.volume.slabs(full, half, averaged)

    @torch.jit.export
    def relate_flow(self, ref: Tensor, src: Tensor) -> Tensor:
        if self.pairwise:
            return self.pair_flow(ref, src)
        raise RuntimeError("this aggregation relates no pairs of views")

    @torch.jit.export
    def flow(self, features: Tensor, neighbours: Tensor) -> Tensor:
        scores = [self.flow_net(features[b, self.ignored :].t(), neighbours[b]) for b in range(features.shape[0])]
        return torch.stack(scores)


def mlp2d(channels: tuple[int, ...], norm: str) -> nn.Sequential:
    """An MLP shared by all pixels."""
    return nn.Sequential(*(Conv2d(a, b, 1, 1, norm) for a, b in zip(channels, channels[1:])))
