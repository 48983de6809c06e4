"""Other methods' own code on the files of their tasks (config/peers.yaml), which a run has made:

    git clone https://github.com/yuan-yin/APHYNITY
    python benchmarks/peers_code.py aphynity APHYNITY results/peers/aphynity_pendulum/data --hours 2
    git clone https://github.com/n-takeishi/phys-vae
    python benchmarks/peers_code.py phys-vae phys-vae results/peers/phys_vae_pendulum/data

Their settings and lengths are those of their scripts; one thread.  Validation selects the pass that is kept.  A row of
results/published/search/tables/peers_code.md is our metric on the test set, with its 95 % interval over windows, and
how long the training had.  A training goes on where it was stopped (APHYNITY) or is made whole (phys-vae).

Of APHYNITY's code torchvision, which it imports for figures, is left out, and its solver (torchdiffeq's rk4) is
compiled in one piece, which halves the time of a step.  Nothing of phys-vae's is changed; it sees the last point too.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
import types
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from expertaug.trajectories import Trajectories

DRAWS = 2000
TABLE = Path(__file__).parents[1] / "results" / "published" / "search" / "tables" / "peers_code.md"
HEAD = "| code | task | passes | minutes | seed | test: log-MSE | ω0: error [%] |"
RULE = "| --- | --- | --- | ---: | ---: | ---: | ---: |"
PASSES = 50_000  # of APHYNITY's script, each of five steps
TRUE = OrderedDict(omega0_square=(2 * math.pi / 6) ** 2, alpha=0.2)  # of its pendulum
EVERY = 100  # passes from one validation to the next there
SAVED_S = 60.0
# Of phys-vae's pendulum_train.sh, physnn.
PHYS_VAE = """
--range-omega 0.392 3.53 --hidlayers-aux1-dec 64 64 --hidlayers-aux2-dec 128 128 --x-lnvar -9.0 --arch-feat mlp
--hidlayers-feat 128 128 --num-units-feat 256 --hidlayers-unmixer 128 128 --hidlayers-aux1-enc 64 32
--hidlayers-aux2-enc 64 32 --hidlayers-omega 64 32 --learning-rate 1e-3 --train-size 1000 --batch-size 200
--epochs 5000 --grad-clip 5.0 --intg-lev 1 --weight-decay 1e-6 --adam-eps 1e-3 --balance-kld 1.0 --save-interval 999999
--num-workers 0 --activation elu --dim-z-aux1 1 --dim-z-aux2 2 --balance-unmix 1e-3 --balance-dataug 1e-1
--balance-lact-dec 1e-2 --balance-lact-enc 1e-2
"""


@dataclass(frozen=True)
class Row:
    """What a training came to."""

    name: str
    task: str
    found: np.ndarray  # forecasts (N, T, K)
    true: np.ndarray  # what was measured there
    off: np.ndarray  # relative errors of omega0
    given: str
    minutes: float
    seed: int

    def cells(self, code: Path) -> list[str]:
        """As the table has them."""
        error = np.square(self.found - self.true).mean((1, 2))
        rng = np.random.default_rng(0)
        draws = np.log([rng.choice(error, len(error)).mean() for _ in range(DRAWS)])
        numbers = (np.log(error.mean()), *np.quantile(draws, (0.025, 0.975)))
        mean, low, high = (f"{number:.2f}".replace("-", "−") for number in numbers)
        command = ["git", "-C", str(code), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
        off = f"{100 * np.abs(self.off).mean():.1f}"
        name = f"{self.name} ({commit})"
        return [name, self.task, self.given, f"{self.minutes:.0f}", str(self.seed), f"{mean} [{low}, {high}]", off]


def write(cells: list[str]) -> None:
    """Print a row, and put it into the table in the place of one of the same method and task."""
    lines = TABLE.read_text(encoding="utf-8").splitlines() if TABLE.exists() else []
    rows = [line for line in lines[2:] if line.split(" | ")[1:2] != cells[1:2]]
    line = f"| {' | '.join(cells)} |"
    print(line)
    TABLE.parent.mkdir(exist_ok=True)
    TABLE.write_text("\n".join([HEAD, RULE, *sorted([*rows, line])]) + "\n", encoding="utf-8")


class Windows(Dataset):
    """A set as APHYNITY's loaders give it: states (K, T) and times."""

    def __init__(self, data: Path, name: str) -> None:
        self.params = TRUE  # its log compares with them
        trajectories = Trajectories.load(data / f"{name}.npz")
        self.t = torch.from_numpy(trajectories.t).float()
        self.states = torch.from_numpy(trajectories.y).float().transpose(1, 2).contiguous()

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        return {"states": self.states[index], "t": self.t}


def compiled(rate: torch.nn.Module, t: torch.Tensor) -> types.FunctionType:
    """torchdiffeq's rk4 (the 3/8 rule) on even times in one compiled piece: half the time of a step."""
    h, steps = float(t[1] - t[0]), len(t) - 1

    def solve(y: torch.Tensor) -> torch.Tensor:
        found = [y]
        for _ in range(steps):
            k1 = rate(None, y)
            k2 = rate(None, y + h * k1 / 3)
            k3 = rate(None, y + h * (k2 - k1 / 3))
            k4 = rate(None, y + h * (k1 - k2 + k3))
            y = y + (k1 + 3 * (k2 + k3) + k4) * h / 8
            found.append(y)
        return torch.stack(found)

    return torch.compile(solve, dynamic=False)


def aphynity(code: Path, data: Path, work: Path, seed: int, hours: float) -> Row:
    """Train its model of an incomplete pendulum, as train_aphynity.py does, with our sets and by our validation."""
    figures = types.ModuleType("torchvision.utils")
    figures.make_grid = None  # type: ignore[attr-defined]  # imported there and not used
    sys.modules |= {"torchvision": types.ModuleType("torchvision"), "torchvision.utils": figures}
    sys.path.insert(0, str(code))
    from experiments import APHYNITYExperiment
    from forecasters import Forecaster
    from networks import MLP, DampedPendulumParamPDE
    from utils import fix_seed, init_weights

    fix_seed(seed)
    sets = {name: Windows(data, name) for name in ("train", "validation", "test")}
    loaders = [DataLoader(sets[name], batch_size=25, shuffle=name == "train") for name in ("train", "validation")]
    learned = MLP(state_c=2, hidden=200)
    init_weights(learned, init_type="orthogonal", init_gain=0.2)
    net = Forecaster(DampedPendulumParamPDE(is_complete=False, real_params=None), learned, is_augmented=True)
    solve = compiled(net.derivative_estimator, sets["train"].t)
    own, net.int_ = net.int_, lambda _, y0, **__: solve(y0)
    options = {"min_op": "l2_normalized", "lambda_0": 1.0, "tau_2": 1, "niter": 5, "nlog": 10, "nupdate": EVERY}
    optimiser = torch.optim.Adam(net.parameters(), lr=1e-3, betas=(0.9, 0.999))
    trainer = APHYNITYExperiment(
        train=loaders[0], test=loaders[1], net=net, optimizer=optimiser, nepoch=PASSES, path=str(work), device="cpu",
        **options,
    )  # fmt: skip
    sys.stdout = sys.__stdout__  # its log would take it
    state, best, passes, spent = work / f"aphynity_{seed}.pt", (math.inf, net.state_dict()), 0, 0.0
    if state.exists():
        kept = torch.load(state, weights_only=False)
        net.load_state_dict(kept["net"])
        optimiser.load_state_dict(kept["optimiser"])
        trainer._lambda, best, passes, spent = (kept[key] for key in ("weight", "best", "passes", "spent"))
        torch.set_rng_state(kept["random"])
    begun, saved, cpu = time.monotonic(), time.monotonic(), time.process_time()
    while passes < PASSES and time.monotonic() - begun < 3600 * hours:
        for batch in loaders[0]:
            for _ in range(5):
                _, _, loss, _ = trainer.train_step(batch)
        trainer.lambda_update(loss["loss"].item())
        passes += 1
        if passes % EVERY == 0:
            score = sum(trainer.val_step(batch)[2]["loss"].item() for batch in loaders[1])
            if score < best[0]:
                best = score, {name: value.clone() for name, value in net.state_dict().items()}
            square = float(net.get_pde_params()["omega0_square"].detach())
            print(f"pass {passes}: validation {math.log(score):.2f}, omega0 {square**0.5:.4f}", flush=True)
        if time.monotonic() - saved > SAVED_S or passes == PASSES:
            saved, now = time.monotonic(), spent + time.process_time() - cpu
            kept = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "weight": trainer._lambda}
            kept |= {"best": best, "passes": passes, "spent": now, "random": torch.get_rng_state()}
            torch.save(kept, state.with_suffix(".new"))
            state.with_suffix(".new").replace(state)
    net.load_state_dict(best[1])
    with torch.no_grad():
        first, t = sets["test"].states[:, :, 0], sets["test"].t
        found = own(net.derivative_estimator, y0=first, t=t, method="rk4").movedim(0, 1)
        square = float(net.get_pde_params()["omega0_square"])
    true = sets["test"].states.transpose(1, 2)
    minutes = (spent + time.process_time() - cpu) / 60
    off = np.array([square**0.5 / TRUE["omega0_square"] ** 0.5 - 1])
    given = f"{passes:,} of {PASSES:,}"
    return Row("APHYNITY", "aphynity_pendulum", found.numpy(), true.numpy(), off, given, minutes, seed)


def phys_vae(code: Path, data: Path, work: Path, seed: int) -> Row:
    """Train its model of a pendulum, as pendulum_train.sh does, on the angles of our sets; it sees all of a window."""
    sets = {name: Trajectories.load(data / f"{name}.npz") for name in ("train", "validation", "test")}
    for name, own in (("train", "train"), ("validation", "valid")):
        np.savetxt(work / f"data_{own}.txt", sets[name].y[..., 0])
        (work / f"args_{own}.json").write_text(json.dumps({"dt": float(np.diff(sets[name].t).mean())}))
    paths = ["--datadir", str(work.resolve()), "--outdir", str(work.resolve()), "--seed", str(seed)]
    if not (work / "done").exists():
        call = [sys.executable, "-m", "physvae.pendulum.train", *paths, *PHYS_VAE.split()]
        with (work / "messages.txt").open("w") as log:
            subprocess.run(call, cwd=code, check=True, stdout=log)
        (work / "done").touch()
    sys.path.insert(0, str(code))
    from physvae.pendulum.model import VAE

    model = VAE(json.loads((work / "args.json").read_text()))
    model.load_state_dict(torch.load(work / "model.pt"))
    model.eval()
    angle = torch.from_numpy(sets["test"].y[..., 0]).float()
    with torch.no_grad():
        stats = model.encode(angle)[:3]
        found = model.decode(*model.draw(*stats, hard_z=True), angle[:, :1])[0]
    true = sets["test"].z_e[:, 0]
    passes = np.loadtxt(work / "log.txt")
    off = stats[0]["mean"][:, 0].numpy() / true - 1
    measured, given = angle[..., None].numpy(), f"{len(passes):,} of 5,000"
    return Row(
        "phys-vae", "phys_vae_pendulum", found[..., None].numpy(), measured, off, given, passes[-1, -1] / 60, seed
    )


def main() -> None:
    """Run one of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("method", choices=("aphynity", "phys-vae"))
    parser.add_argument("code", type=Path, help="a checkout of its authors' repository")
    parser.add_argument("data", type=Path, help="the folder of the task's sets")
    parser.add_argument("--work", type=Path, default=Path("peers_code"), help="folder of what is kept meanwhile")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hours", type=float, default=12.0, help="stop then; the same command goes on (APHYNITY)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    args.work.mkdir(parents=True, exist_ok=True)
    if args.method == "aphynity":
        row = aphynity(args.code, args.data, args.work, args.seed, args.hours)
    else:
        row = phys_vae(args.code, args.data, args.work, args.seed)
    write(row.cells(args.code))


if __name__ == "__main__":
    main()
