"""Seconds that the paper's four configurations take to train, after compilation.

    python benchmarks/mlp_training.py [--epochs N] [--threads N] [--torch]

The samples are random numbers in the shapes of the published data: three principals, two grippers,
fifteen objects (the egg carton has no parallel grasp), four fifths for training and the rest for
validation after every epoch. With --torch one network is also trained by a plain PyTorch loop, for
a few epochs in the same run.
"""

from __future__ import annotations

import argparse
import os
import time
from itertools import pairwise

import numpy as np

from graspcast.forecasting.models.mlp.train import train
from graspcast.forecasting.models.mlp.types import MlpSettings, Problem, ValidationSet

# Images of each object in which all three estimators have a pose (LM-O, then YCB-V).
SAMPLES = [175, 193, 166, 200, 178, 142, 132, 198, 225, 375, 427, 150, 75, 216, 300]
EGG_CARTON = 5
CONFIGURATIONS = {
    "MLP": (12, 1, 1),
    "MLP-O": (27, 15, 1),
    "MLP-G": (14, 1, 2),
    "MLP-OG": (29, 15, 2),
}
PRINCIPALS, GRIPPERS = 3, 2


def problems(inputs: int, objects: int, grippers: int) -> list[Problem]:
    """Random problems; ``objects`` and ``grippers`` say how many one network pools."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(PRINCIPALS):
        for gripper in range(0, GRIPPERS, grippers):
            for first in range(0, len(SAMPLES), objects):
                groups = np.concatenate(
                    [
                        np.full(SAMPLES[k], k)
                        for g in range(gripper, gripper + grippers)
                        for k in range(first, first + objects)
                        if (g, k) != (0, EGG_CARTON)
                    ]
                    or [np.zeros(0, int)]
                )
                if len(groups) == 0:
                    continue
                x = rng.normal(size=(len(groups), inputs))
                y = x @ rng.normal(size=inputs) + rng.normal(size=len(groups)) > 0
                test = rng.random(len(groups)) < 0.2
                validation = ValidationSet(x[test], y[test], groups[test])
                found.append(Problem(x[~test], y[~test], (validation,), seed=len(found)))
    return found


def torch_seconds(problem: Problem, settings: MlpSettings, epochs: int) -> float:
    """CPU seconds that an epoch takes in a plain PyTorch loop, which tests after each."""
    import torch

    torch.set_num_threads(1)  # more make networks of this size slower
    layers: list[torch.nn.Module] = []
    widths = [problem.inputs.shape[1], *settings.hidden, 1]
    for n_in, n_out in pairwise(widths):
        layers += [torch.nn.Linear(n_in, n_out), torch.nn.ReLU()]
    net = torch.nn.Sequential(*layers[:-1], torch.nn.Sigmoid())
    optimiser = torch.optim.Adam(net.parameters(), lr=settings.rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.epochs)
    x, y = torch.tensor(problem.inputs).float(), torch.tensor(problem.labels).float()
    x_test = torch.tensor(problem.validation[0].inputs).float()
    y_test = torch.tensor(problem.validation[0].labels)
    began = time.process_time()
    for _ in range(epochs):
        order = torch.randperm(len(y))
        for start in range(0, len(y), settings.batch):
            chosen = order[start : start + settings.batch]
            optimiser.zero_grad()
            loss = torch.nn.functional.binary_cross_entropy(net(x[chosen])[:, 0], y[chosen])
            loss.backward()
            optimiser.step()
        schedule.step()
        with torch.no_grad():
            ((net(x_test)[:, 0] > 0.5) == y_test).float().mean().item()
    return (time.process_time() - began) / epochs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--epochs", type=int, default=3000)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--torch", action="store_true", help="compare with a PyTorch loop")
    arguments = parser.parse_args()
    settings = MlpSettings(epochs=arguments.epochs)

    began = time.perf_counter()
    train(problems(12, 1, 1)[:1], MlpSettings(epochs=1))
    print(f"compiled, or loaded from numba's cache: {time.perf_counter() - began:.1f} s")
    print(f"{'':8}{'networks':>10}{'samples':>10}{'seconds':>10}{'CPU s':>8}{'µs a step':>11}")
    total = 0.0
    for name, shape in CONFIGURATIONS.items():
        batch = problems(*shape)
        began, used = time.perf_counter(), time.process_time()
        train(batch, settings, threads=arguments.threads)
        seconds, used = time.perf_counter() - began, time.process_time() - used
        samples = sum(len(problem.labels) for problem in batch)
        steps = sum(-(-len(problem.labels) // settings.batch) for problem in batch)
        step = used / steps / settings.epochs * 1e6
        print(f"{name:8}{len(batch):10}{samples:10}{seconds:10.2f}{used:8.2f}{step:11.2f}")
        total += seconds
    print(f"all four: {total:.1f} s for {settings.epochs} epochs on {arguments.threads} threads")

    if arguments.torch:
        one = problems(12, 1, 1)[0]
        torch, ours = [], []
        for _ in range(5):  # alternately, so that other load affects both
            torch.append(torch_seconds(one, settings, 10))
            began = time.process_time()
            train([one], MlpSettings(epochs=1000), threads=1)
            ours.append((time.process_time() - began) / 1000)
        print(
            f"one network of {len(one.labels)} samples on one thread, CPU time of an epoch, "
            f"median of 5: PyTorch {np.median(torch) * 1e3:.2f} ms, "
            f"ours {np.median(ours) * 1e3:.4f} ms, ratio {np.median(torch) / np.median(ours):.0f}"
        )


if __name__ == "__main__":
    main()
