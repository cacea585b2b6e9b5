"""Adam (Kingma and Ba 2015) by torch's fused kernels, not torch.optim.Optimizer; learning rates.

The first Optimizer of a process imports torch's compiler, which this program does not use.  That
import takes 6 of the first 18 s of a run on a GPU host, 1 s on two CPU cores.
"""

from collections import defaultdict
from itertools import groupby
from math import cos, pi

import torch
from torch.optim.adam import adam

from .training_field import TrainingField

BETAS, EPSILON = (0.9, 0.99), 1e-15  # of the moments; the paper has 0.999
FULL_RATE_WIDTH = 64  # of hidden layers that learn as fast as the rest


def learning_rate(step: int, step_count: int, highest: float, final_rate: float) -> float:
    """The learning rate at a step: cosine decay to final_rate · highest.

    `LossWatch.rate_share` multiplies it: a warm-up, and half after each return.
    """
    fall = 0.5 * (1.0 + cos(pi * step / step_count))
    return highest * (final_rate + (1.0 - final_rate) * fall)


def rate_groups(field: TrainingField, parameters) -> list[dict]:
    """Groups of parameters side by side with one learning rate, and its "share" of the highest.

    Adam moves every weight equally far.  In wide layers that moves the sums further: an object of
    one color drove layers of 256 to colors of 0 and 1 within 26 steps.  So their rate falls with
    their width.
    """
    color = {id(weights) for weights in field.networks.color.parameters()}
    share = min(1.0, FULL_RATE_WIDTH / max(field.options.color_hidden, default=1))
    groups = groupby(parameters, key=lambda weights: id(weights) in color)
    return [
        {"params": list(some), "share": share if is_color else 1.0} for is_color, some in groups
    ]


class Adam:
    """Adam for groups of parameters.

    Attributes:
        param_groups: Dictionaries of a group's "params" and its rate "lr": on CUDA a tensor on the
            device, which recorded steps read.
        state: Of each parameter that had a gradient: "step", "exp_avg", "exp_avg_sq".
    """

    def __init__(self, groups: list[dict]):
        self.param_groups = groups
        self.state = defaultdict(dict)

    def zero_grad(self):
        """Forget the gradients, and free their memory."""
        for parameter in self._parameters():
            parameter.grad = None

    @torch.no_grad()
    def forget(self):
        """Begin anew, with moments of 0 in the memory that recorded steps read."""
        for state in self.state.values():
            for value in state.values():
                value.zero_()

    @torch.no_grad()
    def step(self):
        """Update the parameters that have gradients."""
        for group in self.param_groups:
            some = [p for p in group["params"] if p.grad is not None]
            if not some:
                continue
            states = [self.state_of(p) for p in some]
            adam(
                some,
                [p.grad for p in some],
                [state["exp_avg"] for state in states],
                [state["exp_avg_sq"] for state in states],
                [],
                [state["step"] for state in states],
                fused=True,
                amsgrad=False,
                beta1=BETAS[0],
                beta2=BETAS[1],
                lr=group["lr"],
                weight_decay=0.0,
                eps=EPSILON,
                maximize=False,
            )

    def state_of(self, parameter) -> dict:
        """The state of a parameter; zeros before the first update."""
        state = self.state[parameter]
        if not state:
            state["step"] = torch.zeros((), device=parameter.device)
            for name in "exp_avg", "exp_avg_sq":
                state[name] = torch.zeros_like(parameter, requires_grad=False)
        return state

    def _parameters(self):
        return [parameter for group in self.param_groups for parameter in group["params"]]

    def numbered_state(self) -> dict:
        """The state by the number of the parameter, as torch.optim.Adam has it in a state_dict."""
        numbered = enumerate(self._parameters())
        return {number: self.state[p] for number, p in numbered if self.state.get(p)}

    def load(self, numbered: dict, scale: float = 1.0):
        """Go on from a `numbered_state`.

        Args:
            scale: The scale of the gradients to come, over that of the gradients so far.

        Raises:
            IndexError, KeyError, TypeError, ValueError, AttributeError, RuntimeError: It isn't one
                of these parameters.
        """
        parameters = self._parameters()
        self.state.clear()
        for number, state in numbered.items():
            parameter = parameters[number]
            for name in "exp_avg", "exp_avg_sq":
                if state[name].shape != parameter.shape:
                    raise ValueError(f"{name} of parameter {number} has shape {state[name].shape}")
            self.state[parameter] = {
                "step": state["step"].to(parameter.device, torch.float32).reshape(()),
                "exp_avg": scale * state["exp_avg"].to(parameter),
                "exp_avg_sq": scale**2 * state["exp_avg_sq"].to(parameter),
            }
