"""Writes the weights of a cascade of vis-corr for the crate `vamvs-corr`, which needs no libtorch:
`python weights.py NETWORK.pt OUT.safetensors`. Needs `torch==2.11.0` and `safetensors`.

The tensors keep their names. What vamvs-corr does not run is left out. Kernels are written at half precision if that
changes none of their values (`export.py --half`), else as they are."""

import argparse
import json

import torch
from safetensors.torch import save_file
from torch import Tensor

# Levels of the pyramid that a cascade does not use, its flow, and counters of training.
UNUSED = ("pyramid.up1", "pyramid.side1", "pyramid.out1", "pyramid.out3", "flow_net", "enlarge_net.bilinear")


def stored(value: Tensor) -> Tensor:
    """At half precision if that changes nothing."""
    small = value.half()
    return small if torch.equal(small.float(), value) else value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", metavar="NETWORK.pt")
    parser.add_argument("out", metavar="OUT.safetensors")
    arguments = parser.parse_args()
    network = torch.jit.load(arguments.network, map_location="cpu")
    about = json.loads(network.manifest())
    if about["aggregation"] != "vis-corr" or "cascade" not in about:
        parser.error(f"{arguments.network}: expected a cascade of vis-corr, found {about['name']}")
    weights = {
        name: stored(value.contiguous())
        for name, value in network.state_dict().items()
        if value.is_floating_point() and not name.startswith(UNUSED)
    }
    save_file(weights, arguments.out, {"manifest": json.dumps(about)})
    half = sum(value.dtype == torch.float16 for value in weights.values())
    print(f"{len(weights)} tensors, {half} of them at half precision")


if __name__ == "__main__":
    main()
