"""NVIDIA Newton's soft body solvers on a scene of xpbd_peers.py: pip install newton."""

import numpy as np
import warp as wp

try:
    import newton
except ImportError:
    newton = None

LITTLE = 1e-6  # of K: k_mu of tets that shall resist volume alone


def newton_model(scene, energy):
    """The scene's object, with springs at its edges if the energy is one of ours.

    Held vertices have mass 0, and particles radius 0: there are no contacts to look for.
    """
    builder = newton.ModelBuilder(gravity=scene.gravity)
    masses = np.where(scene.held, 0.0, scene.energy.masses).tolist()
    still, points = np.zeros_like(scene.rest).tolist(), [0.0] * len(masses)
    builder.add_particles(scene.rest.tolist(), still, masses, radius=points)
    if energy in scene.energies:
        ours = scene.energies[energy]
        ends, stiffnesses = ours.edges.tolist(), ours.stiffnesses.tolist()
        for (i, j), stiffness in zip(ends, stiffnesses, strict=True):
            builder.add_spring(i, j, stiffness, 0.0, 0.0)
        moduli = 6.0 * ours.volume_stiffnesses * ours.volumes  # K of each tet
        for tet, bulk in zip(ours.tets.tolist(), moduli.tolist(), strict=True):
            if bulk > 0.0:
                builder.add_tetrahedron(*tet, k_mu=LITTLE * bulk, k_lambda=bulk)
    else:
        mu, lame = scene.moduli[energy]
        for tet in scene.tets.tolist():
            builder.add_tetrahedron(*tet, k_mu=mu, k_lambda=lame)
    builder.color()
    model = builder.finalize(device=scene.device)
    model.particle_grid = None
    model.particle_max_velocity = scene.speed_limit
    return model


@wp.kernel
def drive_kernel(
    inverse_masses: wp.array(dtype=float),  # [V] 0 = held
    starts: wp.array(dtype=wp.vec3),  # [V] of held vertices, in this frame
    targets: wp.array(dtype=wp.vec3),  # [V]
    fraction: float,  # of the frame that is over after this substep
    decay: float,
    vertices: wp.array(dtype=wp.vec3),  # [V] in and out
    velocities: wp.array(dtype=wp.vec3),  # [V] in and out
):
    i = wp.tid()
    if inverse_masses[i] > 0.0:
        velocities[i] = decay * velocities[i]
    else:
        vertices[i] = wp.lerp(starts[i], targets[i], fraction)
        velocities[i] = wp.vec3()


class NewtonPeer:
    """A solver of Newton's.  Handles and damping are its caller's: one launch a substep.

    Args:
        scene: See xpbd_peers.py.
        model: newton_model's.
        substeps: An even number, so that the two states end a frame as they began it.
        dt: Of a frame [s].
        solver: "SolverXPBD" or "SolverVBD".
        iterations: Per substep.
    """

    def __init__(self, scene, model, substeps, dt, solver, iterations):
        self.model, self.substeps, self.h = model, substeps, dt / substeps
        self.decay = float(np.exp(-scene.damping * self.h))
        self.solver = getattr(newton.solvers, solver)(model, iterations=iterations)
        self.now, self.then = model.state(), model.state()
        self.starts, self.targets = (wp.clone(self.now.particle_q) for _ in range(2))
        self.vertices, self.graph = self.now.particle_q, None

    def move(self, places):
        """Where held vertices shall be after the next frame.  [V, 3]"""
        wp.copy(self.starts, self.targets)
        self.targets.assign(places.astype(np.float32))

    def step(self):
        if self.graph is not None:
            wp.capture_launch(self.graph)
            return
        self._frame()
        # On the CPU too: 20 substeps of 46 tets take 0.2 ms instead of 6.
        with wp.ScopedCapture(device=self.model.device) as capture:
            self._frame()
        self.graph = capture.graph

    def _frame(self):
        for substep in range(self.substeps):
            inputs = [self.model.particle_inv_mass, self.starts, self.targets]
            inputs += [(substep + 1) / self.substeps, self.decay]
            inputs += [self.now.particle_q, self.now.particle_qd]
            wp.launch(drive_kernel, len(self.starts), inputs, device=self.model.device)
            self.solver.step(self.now, self.then, None, None, self.h)
            self.now, self.then = self.then, self.now
