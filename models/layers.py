"""Layers shared by the networks: convolution, normalisation and ReLU in 1D, 2D and 3D.

In evaluation mode a BatchNorm is an affine map, so it is folded into the convolution's weights at every call:
one pass over the data instead of three. In training mode it is an ordinary BatchNorm.
"""

from typing import Final, Optional

import torch
import torch.nn.functional as F
from torch import Tensor, nn

NORMS = ("batch", "group")


def normalised(images: Tensor) -> Tensor:
    """Each image with zero mean and unit standard deviation, as in the authors' implementation, channels last."""
    mean = images.mean(dim=(1, 2, 3), keepdim=True)
    deviation = images.std(dim=(1, 2, 3), keepdim=True)
    return ((images - mean) / (deviation + 1e-3)).contiguous(memory_format=torch.channels_last)


class ChannelNorm(nn.Module):
    """Normalises the channels of each position to zero mean and unit variance, then scales and shifts: (B, C, ...)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        return F.layer_norm(x.transpose(1, -1), self.weight.shape, self.weight, self.bias).transpose(1, -1)


def normalisation(kind: str, channels: int, dims: int, local: bool) -> nn.Module:
    """The normalisation of a layer. `batch` is BatchNorm. `group` is GroupNorm, which is the same in both modes and for
    any batch size. If the result must not depend on what is computed together (`local`: planes in slabs, points in
    strips), `group` normalises only over the channels of each position."""
    if kind == "batch":
        return (nn.BatchNorm1d, nn.BatchNorm2d, nn.BatchNorm3d)[dims - 1](channels)
    if kind == "group":
        return ChannelNorm(channels) if local else nn.GroupNorm(max(1, channels // 8), channels)
    raise ValueError(f"normalisation must be one of {NORMS}, not {kind!r}")


def scale_shift(weight: Tensor, bias: Tensor, mean: Optional[Tensor], var: Optional[Tensor]) -> tuple[Tensor, Tensor]:
    """Scale and shift of a BatchNorm in evaluation mode, which is x → x · scale + shift."""
    assert mean is not None and var is not None
    scale = weight * torch.rsqrt(var + 1e-5)  # PyTorch's default epsilon
    return scale, bias - mean * scale


class Conv1d(nn.Module):
    """A layer of a shared MLP: (C, P) → (C', P). Points are the columns of a matrix, so a layer is one product."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.conv = nn.Conv1d(c_in, c_out, 1, bias=False)
        self.norm = normalisation(norm, c_out, 1, True)

    def folded(self) -> list[Tensor]:
        """Weight (C', C) and shift (C') with the BatchNorm of evaluation mode folded in."""
        if self.batch:
            n = self.norm
            scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
            return [self.conv.weight[:, :, 0] * scale[:, None], shift]
        raise RuntimeError("only a BatchNorm can be folded")

    def forward(self, x: Tensor) -> Tensor:
        if self.batch:
            if not self.training:
                weight, shift = self.folded()
                return torch.addmm(shift[:, None], weight, x).relu_()
        return F.relu(self.norm(torch.mm(self.conv.weight[:, :, 0], x)[None])[0])


class Pair1d(Conv1d):
    """The first layer of a shared MLP on pairs [a, b], which are not concatenated: a (A, P), b (C, B · P) →
    (C', B · P). The part that depends on `a` alone is computed once."""

    def __init__(self, c_a: int, c_b: int, c_out: int, norm: str) -> None:
        super().__init__(c_a + c_b, c_out, norm)
        self.c_a = c_a

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        if self.batch:
            if not self.training:
                weight, shift = self.folded()
                return self.joined(torch.addmm(shift[:, None], weight[:, : self.c_a], a), weight, b).relu_()
        weight = self.conv.weight[:, :, 0]
        return F.relu(self.norm(self.joined(torch.mm(weight[:, : self.c_a], a), weight, b)[None])[0])

    def joined(self, of_a: Tensor, weight: Tensor, b: Tensor) -> Tensor:
        of_b = torch.mm(weight[:, self.c_a :], b)
        return of_b.view(of_b.shape[0], -1, of_a.shape[1]).add_(of_a[:, None]).view(of_b.shape)


class Conv2d(nn.Module):
    """(B, C, H, W) → (B, C', H/stride, W/stride). With an odd kernel for stride 1 and an even one for stride 2, output
    pixels are centred on the input pixels that they cover. With an odd kernel for stride 2 they are half an input pixel to
    the left and to the top."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, kernel: int, stride: int, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.stride = stride
        self.padding = (kernel - 1) // 2
        self.conv = nn.Conv2d(c_in, c_out, kernel, stride, (kernel - 1) // 2, bias=False)
        self.norm = normalisation(norm, c_out, 2, kernel == 1)

    def forward(self, x: Tensor) -> Tensor:
        if self.batch:
            if not self.training:
                n = self.norm
                scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
                weight = self.conv.weight * scale[:, None, None, None]
                return F.conv2d(x, weight, shift, self.stride, self.padding).relu_()
        return F.relu(self.norm(self.conv(x)))


def few(x: Tensor) -> bool:
    """Whether libtorch would convolve one sample (1, C, D, H, W) without oneDNN, many times slower, and would not with
    the sides reversed: it leaves out the last side in the number of values that must be above a bound
    (`ConvParams::use_mkldnn`)."""
    bound = 20480
    c, d, h, w = x.shape[1], x.shape[2], x.shape[3], x.shape[4]
    return x.is_cpu and x.shape[0] == 1 and c * d * h <= bound and bound < c * h * w


def conv3d(x: Tensor, weight: Tensor, bias: Optional[Tensor], stride: int, padding: list[int]) -> Tensor:
    """As `F.conv3d`, by oneDNN also where few values are convolved."""
    if few(x):
        padding = [padding[2], padding[1], padding[0]]
        return F.conv3d(x.transpose(2, 4), weight.transpose(2, 4), bias, stride, padding).transpose(2, 4)
    return F.conv3d(x, weight, bias, stride, padding)


class Conv3d(nn.Module):
    """3×3×3 convolution: (B, C, D, H, W) → (B, C', D/stride, H/stride, W/stride)."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, stride: int, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.stride = stride
        self.conv = nn.Conv3d(c_in, c_out, 3, stride, 1, bias=False)
        self.norm = normalisation(norm, c_out, 3, False)

    def folded(self) -> tuple[Tensor, Tensor]:
        """Weight and shift of the convolution with the BatchNorm of evaluation mode folded in."""
        if self.batch:
            n = self.norm
            scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
            return self.conv.weight * scale[:, None, None, None, None], shift
        raise RuntimeError("only a BatchNorm can be folded")

    def forward(self, x: Tensor) -> Tensor:
        if self.batch:
            if not self.training:
                n = self.norm
                scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
                weight = self.conv.weight * scale[:, None, None, None, None]
                return conv3d(x, weight, shift, self.stride, [1, 1, 1]).relu_()
        return F.relu(self.norm(self.conv(x)))


def doubled(x: Tensor, weight: Tensor, bias: Optional[Tensor]) -> Tensor:
    """As `F.conv_transpose3d(x, weight, bias, 2, 1, 1)` with a 3×3×3 kernel, on CPUs in half of the time. Along an axis
    output 2k is w₁ x[k], and output 2k + 1 is w₂ x[k] + w₀ x[k + 1]: a 2×2×2 convolution gives all eight outputs of a
    position as channels, which are then put in their places."""
    c_in, c_out = weight.shape[0], weight.shape[1]
    taps = torch.tensor([1, 3, 2, 0], device=weight.device)  # of outputs 2k and 2k + 1, the two taps each; 3: none
    weight = F.pad(weight, [0, 1, 0, 1, 0, 1])
    weight = weight.index_select(2, taps).index_select(3, taps).index_select(4, taps)
    weight = weight.view(c_in, c_out, 2, 2, 2, 2, 2, 2).permute(1, 2, 4, 6, 0, 3, 5, 7).reshape(-1, c_in, 2, 2, 2)
    if bias is not None:
        bias = bias.repeat_interleave(8)
    n, _, d, h, w = x.shape
    places = conv3d(F.pad(x, [0, 1, 0, 1, 0, 1]), weight, bias, 1, [0, 0, 0]).reshape(n, c_out, 2, 2, 2, d, h, w)
    return places.permute(0, 1, 5, 2, 6, 3, 7, 4).reshape(n, c_out, 2 * d, 2 * h, 2 * w)


def to_one_channel(x: Tensor, weight: Tensor) -> Tensor:
    """As `F.conv3d(x, weight, None, 1, [0, 1, 1])` of one sample with a 3×3×3 kernel to one channel, (1, C, D + 2, H, W) →
    (1, 1, D, H, W), on CPUs in half of the time: a 2D convolution from the planes of all channels to the planes, because
    libtorch computes eight channels where one is wanted."""
    _, c, d, h, w = x.shape
    of_plane = [F.pad(weight[0], [0, 0, 0, 0, first, d - 3 - first]) for first in range(d - 2)]
    planes = torch.stack(of_plane).view(d - 2, c * d, 3, 3)
    return F.conv2d(x.reshape(1, c * d, h, w), planes, None, 1, 1)[:, None]


class Deconv3d(nn.Module):
    """Transposed 3×3×3 convolution that doubles each side: (B, C, D, H, W) → (B, C', 2D, 2H, 2W)."""

    batch: Final[bool]

    def __init__(self, c_in: int, c_out: int, norm: str) -> None:
        super().__init__()
        self.batch = norm == "batch"
        self.conv = nn.ConvTranspose3d(c_in, c_out, 3, 2, 1, 1, bias=False)
        self.norm = normalisation(norm, c_out, 3, False)

    def forward(self, x: Tensor) -> Tensor:
        if self.batch:
            if not self.training:
                n = self.norm
                scale, shift = scale_shift(n.weight, n.bias, n.running_mean, n.running_var)
                weight = self.conv.weight * scale[None, :, None, None, None]
                return doubled(x, weight, shift).relu_()
        return F.relu(self.norm(self.conv(x)))
