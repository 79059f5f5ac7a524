"""Exports the networks as TorchScript: `python export.py photometric OUT.pt`, `python export.py vis-max OUT.pt`."""

import argparse
import json

import torch
from torch import Tensor, nn

from layers import NORMS
from photometric import Photometric
from va_point_mvsnet import AGGREGATIONS, HYPOTHESES, KERNELS, NEIGHBOURS, STEPS, VaPointMvsNet
from vis_corr import STRIDES, VisCorr


def copy_common(weights: dict[str, Tensor], module: nn.Module) -> None:
    """Copies the weights of all layers that both networks have. If the module's layer has more input channels, the
    weights of the additional ones become zero."""
    own = module.state_dict()
    taken = 0
    for name, value in weights.items():
        target = own.get(name)
        if target is None or target.dim() != value.dim():
            continue
        same = target if target.dim() < 2 else target[:, : value.shape[1]]
        if same.shape == value.shape:
            target.zero_()
            same.copy_(value)
            taken += 1
    print(f"{taken} of {len(own)} tensors copied")


def flow(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The weights of the flow, which shares none with the coarse stage."""
    return {name: value for name, value in weights.items() if name.split(".")[0] in ("flow_images", "pair_flow", "flow_net")}


def mean(networks: list[torch.jit.ScriptModule]) -> dict[str, Tensor]:
    """The mean of the networks' weights. The mean of a network before and after more training is often better than
    both."""
    states = [network.state_dict() for network in networks]
    means = {}
    for name, value in states[0].items():
        if value.is_floating_point():
            value = torch.stack([state[name] for state in states]).mean(0)
        means[name] = value
    return means


def trained_on(networks: list[torch.jit.ScriptModule]) -> list[str]:
    """The training runs of the networks, each once."""
    runs = [run for network in networks for run in json.loads(network.manifest())["trained_on"].split("; ")]
    return list(dict.fromkeys(runs))


def check_flags(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """Refuses flags that the network would ignore."""
    of_paper = ("neighbours", "hypotheses", "no_plane_depth", "no_image_features", "matched", "window", "completion", "guide")
    of_paper += ("coarse_stride", "steps", "flow_sources", "kernel", "thin")
    if arguments.network == "photometric":
        ignored = (*of_paper, "norm", "feature_stride", "cascade")
    elif arguments.network == "vis-corr":
        ignored = (*of_paper, "flow_like")
    else:
        ignored = ("feature_stride", "cascade")
        ignored += () if arguments.network == "vis-var" else ("no_plane_depth",)
    for name in ignored:
        if getattr(arguments, name) != parser.get_default(name):
            parser.error(f"--{name.replace('_', '-')} does not apply to {arguments.network}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=("photometric", "vis-corr", *AGGREGATIONS))
    parser.add_argument("out", help="the .pt file to write")
    parser.add_argument("--norm", choices=NORMS, default="batch", help="normalisation of the learned networks")
    parser.add_argument("--thin", type=int, default=1, help="divide all channels by this, for small test networks")
    parser.add_argument("--neighbours", type=int, default=NEIGHBOURS, help="neighbours of a point; 1: only itself")
    parser.add_argument(
        "--hypotheses", type=int, default=HYPOTHESES, help="to each side of a point; 0: regress the offset directly"
    )
    parser.add_argument("--no-plane-depth", action="store_true", help="vis-var: visibility without the plane's depth")
    parser.add_argument("--no-image-features", action="store_true", help="points have no features but their position")
    parser.add_argument(
        "--matched", action="store_true", help="vis-avg, vis-max: use the handcrafted matcher in the coarse stage"
    )
    parser.add_argument(
        "--window", type=int, help="soft-argmin over this many planes to each side of the most probable one"
    )
    parser.add_argument(
        "--completion", type=float, nargs=2, metavar=("STIFFNESS", "POWER"), help="depth completion of the coarse maps"
    )
    parser.add_argument(
        "--guide", type=float, metavar="GREYS", help="joint bilateral upsampling: standard deviation of colours"
    )
    parser.add_argument("--coarse-stride", type=int, choices=(8, 4), default=8, help="of the coarse depth map, pixels")
    parser.add_argument("--feature-stride", type=int, choices=STRIDES, default=4, help="vis-corr: stride of the coarse features")
    parser.add_argument(
        "--cascade", action="store_true", help="vis-corr: a second volume around the depth of the first, and the probability of a surface"
    )
    parser.add_argument(
        "--steps", type=float, nargs=3, default=STEPS, help="between hypotheses at 1/8, 1/4, 1/2, plane distances"
    )
    parser.add_argument("--flow-sources", type=int, metavar="N", help="the flow uses only the N best source views")
    parser.add_argument(
        "--kernel", type=int, choices=KERNELS, default=4, help="of the convolutions that halve the image; the authors' have 5"
    )
    parser.add_argument("--plane-step", type=float, metavar="PIXELS", help="distance between planes in the source views")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random weights")
    parser.add_argument(
        "--like",
        nargs="+",
        metavar="FILE.pt",
        help="start from the weights of this network, or from the mean of several, in all layers that both have",
    )
    parser.add_argument(
        "--renew", action="store_true", help="also keep the manifest of --like: the same network with the current code"
    )
    parser.add_argument("--half", action="store_true", help="round kernels to half precision, in which weights.py stores them")
    parser.add_argument("--flow-like", metavar="FILE.pt", help="take the flow's weights from this network instead")
    arguments = parser.parse_args()
    if arguments.flow_like is not None and arguments.like is None:
        parser.error("--flow-like replaces the flow's weights of --like, which is missing")
    check_flags(parser, arguments)
    torch.manual_seed(arguments.seed)
    if arguments.network == "photometric":
        module = Photometric()
    elif arguments.network == "vis-corr":
        module = VisCorr(arguments.norm, arguments.feature_stride, arguments.cascade)
    else:
        module = VaPointMvsNet(
            arguments.network,
            arguments.norm,
            arguments.thin,
            arguments.neighbours,
            arguments.hypotheses,
            not arguments.no_plane_depth,
            not arguments.no_image_features,
            arguments.matched,
            arguments.window,
            arguments.completion,
            arguments.guide,
            arguments.coarse_stride,
            tuple(arguments.steps),
            arguments.flow_sources,
            arguments.kernel,
        )
    if arguments.like is not None:
        others = [torch.jit.load(path, map_location="cpu") for path in arguments.like]
        weights = mean(others)
        if arguments.cascade and not any(name.startswith("fine.") for name in weights):
            weights |= {f"fine.{name.removeprefix('volume.')}": value for name, value in weights.items() if name.startswith("volume.")}
        copy_common(weights, module)
        runs = trained_on(others)
        if arguments.flow_like is not None:
            other = torch.jit.load(arguments.flow_like, map_location="cpu")
            copy_common(flow(other.state_dict()), module)
            of_flow = [run.removeprefix("the flow: ") for run in trained_on([other])]
            runs += [f"the flow: {run}" for run in of_flow if run not in runs]
        about = json.loads(module.manifest())
        if arguments.renew:
            about.update(json.loads(others[0].manifest()))
        about["trained_on"] = "; ".join(runs)
        module.set_manifest(json.dumps(about))
    if arguments.plane_step is not None:
        module.set_manifest(json.dumps({**json.loads(module.manifest()), "plane_step": arguments.plane_step}))
    if arguments.half:
        for value in module.state_dict().values():
            if value.dim() > 1:
                value.copy_(value.half().float())
    torch.jit.script(module.eval()).save(arguments.out)


if __name__ == "__main__":
    main()
