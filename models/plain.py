"""A plain rendering of the authors' network, to test `va_point_mvsnet.py` with: `python plain.py NETWORK.pt PLAIN.pt`.

Written down layer by layer in the order of the authors' implementation, for the aggregation `var`: convolution,
BatchNorm, ReLU, each a call of PyTorch, with 5×5 kernels where the image is halved; nothing is folded, cut into chunks
or slabs, or computed once for several uses. Both files get the same random weights and BatchNorm statistics.
"""

import argparse

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from va_point_mvsnet import VaPointMvsNet


def layer2d(c_in: int, c_out: int, kernel: int, stride: int) -> nn.Sequential:
    conv = nn.Conv2d(c_in, c_out, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(c_out), nn.ReLU())


def layer3d(c_in: int, c_out: int, stride: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv3d(c_in, c_out, 3, stride, 1, bias=False), nn.BatchNorm3d(c_out), nn.ReLU())


def up3d(c_in: int, c_out: int) -> nn.Sequential:
    conv = nn.ConvTranspose3d(c_in, c_out, 3, 2, 1, 1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm3d(c_out), nn.ReLU())


class Images(nn.Module):
    def __init__(self, base: int) -> None:
        super().__init__()
        a, b, c, d = base, 2 * base, 4 * base, 8 * base
        self.conv0 = nn.Sequential(layer2d(3, a, 3, 1), layer2d(a, a, 3, 1))
        self.conv1 = nn.Sequential(layer2d(a, b, 5, 2), layer2d(b, b, 3, 1), layer2d(b, b, 3, 1))
        self.conv2 = nn.Sequential(layer2d(b, c, 5, 2), layer2d(c, c, 3, 1), layer2d(c, c, 3, 1))
        self.conv3 = nn.Sequential(layer2d(c, d, 5, 2), layer2d(d, d, 3, 1))
        self.last = nn.Conv2d(d, d, 3, 1, 1, bias=False)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mean, deviation = images.mean((1, 2, 3), True), images.std((1, 2, 3), keepdim=True)
        half = self.conv1(self.conv0((images - mean) / (deviation + 1e-3)))
        quarter = self.conv2(half)
        return half, quarter, self.last(self.conv3(quarter))


class Volume(nn.Module):
    def __init__(self, channels: int, base: int) -> None:
        super().__init__()
        a, b, c, d = base, 2 * base, 4 * base, 8 * base
        self.conv0 = layer3d(channels, a, 1)
        self.conv1_0, self.conv1_1 = layer3d(channels, b, 2), layer3d(b, b, 1)
        self.conv2_0, self.conv2_1 = layer3d(b, c, 2), layer3d(c, c, 1)
        self.conv3_0, self.conv3_1 = layer3d(c, d, 2), layer3d(d, d, 1)
        self.up3, self.up2, self.up1 = up3d(d, c), up3d(c, b), up3d(b, a)
        self.last = nn.Conv3d(a, 1, 3, 1, 1, bias=False)

    def forward(self, volume: Tensor) -> Tensor:  # sides that are multiples of 8
        half = self.conv1_0(volume)
        quarter = self.conv2_0(half)
        quarter = self.up3(self.conv3_1(self.conv3_0(quarter))) + self.conv2_1(quarter)
        half = self.up2(quarter) + self.conv1_1(half)
        return self.last(self.up1(half) + self.conv0(volume))[:, 0]


class Edges(nn.Module):
    def __init__(self, c_in: int, c_out: int, keep_centre: bool) -> None:
        super().__init__()
        self.keep_centre = keep_centre
        self.conv1 = nn.Linear(c_in, c_out, bias=False)
        self.conv2 = nn.Linear(c_in, c_out, bias=False)
        self.bn = nn.BatchNorm2d(2 * c_out if keep_centre else c_out)

    def forward(self, points: Tensor, neighbours: Tensor) -> Tensor:  # (P, C), (P, k) → (P, C')
        centre = self.conv1(points)[:, None].expand(-1, neighbours.shape[1], -1)
        edges = self.conv2(points)[neighbours] - centre
        if self.keep_centre:
            edges = torch.cat((centre, edges), dim=2)
        return F.relu(self.bn(edges.permute(2, 0, 1)[None]))[0].mean(2).t()


class Flow(nn.Module):
    def __init__(self, channels: int, base: int) -> None:
        super().__init__()
        a, b, c = 2 * base, 4 * base, 8 * base
        self.edge1, self.edge2, self.edge3 = Edges(channels, b, False), Edges(b, b, True), Edges(c, c, True)
        wide = b + c + 2 * c
        layers = [[nn.Conv1d(i, o, 1, bias=False), nn.BatchNorm1d(o), nn.ReLU()] for i, o in ((wide, c), (c, c), (c, a))]
        self.mlp = nn.Sequential(*sum(layers, []), nn.Conv1d(a, 1, 1, bias=False))

    def forward(self, points: Tensor, neighbours: Tensor) -> Tensor:
        first = self.edge1(points, neighbours)
        second = self.edge2(first, neighbours)
        third = self.edge3(second, neighbours)
        return self.mlp(torch.cat((first, second, third), 1).t()[None])[0, 0]


class Plain(nn.Module):
    def __init__(self, base: int) -> None:
        super().__init__()
        self.coarse_images = Images(base)
        self.flow_images = Images(base)
        self.volume = Volume(8 * base, base)
        self.flow_net = Flow(14 * base + 24, base)

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        return self.coarse_images(images)[2]

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.flow_images(images)

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        return self.volume(volume)

    @torch.jit.export
    def flow(self, features: Tensor, neighbours: Tensor) -> Tensor:
        return self.flow_net(features[0].t(), neighbours[0])[None]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", help="the .pt file of VaPointMvsNet to write")
    parser.add_argument("plain", help="the .pt file of the plain rendering to write")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    thin = 4
    network, plain = VaPointMvsNet("var", thin=thin, kernel=5), Plain(8 // thin)
    own, others = network.state_dict(), plain.state_dict()
    assert [tensor.shape for tensor in own.values()] == [tensor.shape for tensor in others.values()]
    for tensor, other in zip(own.values(), others.values()):
        if tensor.dim() == 1:  # of a BatchNorm; a variance must be positive
            tensor.uniform_(0.5, 1.5)
        elif tensor.dim() > 1:  # larger than at the start of training, so that the outputs vary
            tensor.mul_(2.0)
        other.copy_(tensor)
    for module, path in ((network, arguments.network), (plain, arguments.plain)):
        torch.jit.script(module.eval()).save(path)


if __name__ == "__main__":
    main()
