"""What the frames say of parts' motions, as a quadratic model about motions that suit them: it asks for no matching.

A tree of joints can so be tried within milliseconds, and it finds its way from far off, where matches to nearest points
would mislead it. Directions in which a part may slide or spin unseen weigh next to nothing.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from stages.kernels.alignment.registration import FRAME_PLANE_SPREAD, NormalEquations
from stages.kernels.motion.rigid_motion import inverse, left_jacobians, move_points, rotation_vectors

TRIAL_STEPS = 10  # Levenberg-Marquardt steps on the model, to judge a chain


class MotionModel:
    """The cost of parts' motions near `Ts` (frames, parts, 4, 4), from the normal equations there.

    Calling it gives cost and normal equations of other motions, as `fit_chain` wants them. Parts behind the model's
    own, of which nothing is known, cost nothing. Costs are in the unit of `Registration.cost`, summed over points and
    counted from the motions' own: negative where other motions suit the frames better.
    """

    def __init__(self, equations: NormalEquations, Ts: Float64[np.ndarray, "frames parts 4 4"], spacing: float) -> None:
        # matches run both ways; the cost of a point is a mean over frames, of plane distances in units of their spread
        scale = 1.0 / (2 * FRAME_PLANE_SPREAD**2 * (len(Ts) - 1))
        self.hessian, self.gradient = scale * equations.hessian, scale * equations.gradient
        self.centres, self.Ts, self.spacing = equations.centres, Ts, spacing
        self.parts = Ts.shape[1]
        self.p_centres = move_points(inverse(Ts), equations.centres)

    def __call__(self, Ts: Float64[np.ndarray, "frames others 4 4"]) -> NormalEquations:
        """Cost and normal equations; twists turn about where the parts' centres lie by `Ts`."""
        known = Ts[:, : self.parts]
        R = known[..., :3, :3] @ np.swapaxes(self.Ts[..., :3, :3], -1, -2)
        turn = rotation_vectors(R)
        centres = move_points(known, self.p_centres)
        twist = np.concatenate([turn, (centres - self.centres) / self.spacing], axis=-1)
        pull = np.einsum("tpij,tpj->tpi", self.hessian, twist)
        cost = float((twist * (pull + 2 * self.gradient)).sum())
        change = np.broadcast_to(np.eye(6), self.hessian.shape).copy()  # d(twist from self.Ts) / d(small twist at Ts)
        change[..., :3, :3] = np.linalg.inv(left_jacobians(turn))
        change_T = np.swapaxes(change, -1, -2)
        shape = Ts.shape[:2]
        hessian, gradient, all_centres = np.zeros((*shape, 6, 6)), np.zeros((*shape, 6)), np.zeros((*shape, 3))
        hessian[:, : self.parts] = change_T @ self.hessian @ change
        gradient[:, : self.parts] = (change_T @ (pull + self.gradient)[..., None])[..., 0]
        all_centres[:, : self.parts] = centres
        return NormalEquations(cost, hessian, gradient, all_centres)
