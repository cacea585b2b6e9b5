"""One frame of the solver, on a CPU and on CUDA: n substeps of core/definition/solver.py, and more.

A substep of length h, s = 0..n−1, with what the definition leaves out:

1.  Prediction.  Vertices of w = 0 go to start + (s + 1)/n · (target − start).  After gravity the
                 air: v ← wind + (v − wind) exp(−c h).  In parts that nothing holds, damping acts
                 once, at the frame's start, and spares their rigid motion (rigid_motion.py).
2.  Edges, then volumes.
3.  Springs.     u = anchor + (s + 1)/n · (target − anchor) − x,   a = 1/(k h²),
                 x ← x + u min(w/(w + a), w F h²/|u|)
4.  Contacts.
5.  Ground.      A vertex that is p below it moves up by p; p = 0 above it.  With the running
                 mean p̄ ← p̄ + (p − p̄) PRESS_SHARE, friction undoes its motion along the ground in
                 this substep, up to a length of friction · p̄.  A vertex that began the substep
                 more than LEAVING_SPEED h below the ground moves up to at most LEAVING_SPEED h
                 above its start; its vertical velocity is then 0.
6.  Colliders.   One after another: a vertex that is p inside moves out by p.  Friction undoes
                 its motion across that direction, relative to the collider, up to friction · p.
7.  Velocities.
At the frame's end: anchor ← target.

In float32 the kernels keep x as the position at the frame's start plus a small delta d, and a
difference x_i − x_j as its span at the frame's start plus d_i − d_j.  With x itself, the roundings
of 20 substeps shake a resting body by 0.2 % of its size for ever (measured).

Units: x [m], v [m/s], h [s], c air drag [1/s], k [N/m], F [N], w [1/kg].
"""
