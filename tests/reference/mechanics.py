"""Places, energies and forces of a reduced body under a method; sections and equations are those of docs/theory.md."""

from copy import copy

import numpy as np

from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import GROUND
from reference.rotations import axial, exponential, hat

# So small that its square vanishes beside anything: the derivative is exact to round-off.
STEP = 1e-100
FRAMED = {Method.FLOATING_FRAME, Method.FRAMES, Method.FRAMES_STIFFNESS, Method.SECOND_ORDER}
TURNED = {Method.MODAL_ROTATION: 1.0, Method.HALF_ROTATION: 0.5}


def slopes(function, q):
    """Derivatives of an analytic function by each coordinate, last axis."""
    return np.stack([np.imag(function(q + 1j * STEP * unit)) / STEP for unit in np.eye(q.size)], axis=-1)


class Node:
    """A point that a frame carries: a joint, an interface, a centre of mass, or an end of a tie."""

    def __init__(self, on, point, displacement, rotation):
        self.on, self.point = on, np.asarray(point)
        # (3, m): of the point, and of what turns with it, of a frame the averaged one.
        self.displacement, self.rotation = displacement, rotation


class Reference:
    """A body under a method.

    Parameters
    ----------
    body : ReducedBody
    method : Method
    mass : Mass
    """

    def __init__(self, body, method, mass=Mass.CONSTANT):
        self.body, self.method, self.mass_kind = body, method, mass
        # Turns of a floating frame are about its own axes: what it has turned so far, and the coordinates that do so.
        self.turned, self.rigid = np.eye(3), body.rigid_count if body.floating and method in FRAMED else 0
        self.stiffness = body.angular_frequency**2
        self.modes = body.mode_count
        self.membrane = body.membrane if method is Method.SECOND_ORDER and body.frame_count else None
        # A body of one frame has that one, whatever it carries.
        self.one = method is Method.FLOATING_FRAME and body.frame_count > 1
        self.nodes = [] if method is Method.LINEAR or "stiffness_by" in method.value else self._frames()
        self.frames = len(self.nodes)
        still = np.zeros((3, self.modes))

        def carried(frame):
            if not self.frames:
                return GROUND
            return 0 if self.one else int(frame)

        zipped = zip(
            body.interface_frame, body.interface_point, body.interface_displacement, body.interface_rotation,
            strict=True,
        )  # fmt: skip
        self.nodes += [Node(carried(f), x, u, w) for f, x, u, w in zipped]
        self.interfaces = slice(self.frames, len(self.nodes))
        if body.masses is not None:
            lumps = zip(body.masses.frame, body.masses.point, body.masses.displacement, strict=True)
            self.nodes += [Node(carried(f), x, u, still) for f, x, u in lumps]
        self.masses = slice(self.interfaces.stop, len(self.nodes))
        self.heavy = mass is not Mass.CONSTANT and self.frames > 0
        # Coordinates whose inertia is that of the deformed body, section 9.
        omega, rigid = body.angular_frequency, body.rigid_count
        self.slow = min(max(int(np.sum(omega <= 20.0 * omega[rigid])), rigid + 6), self.modes)
        if self.heavy:
            data = body.inertia
            lumps = zip(data.frame, data.point, data.displacement, strict=True)
            self.nodes += [Node(int(f), x, u, self.nodes[int(f)].rotation) for f, x, u in lumps]
        self.lumps = slice(self.masses.stop, len(self.nodes))
        # Where nothing that is loaded hangs on a frame, loads act on the undeformed body.
        self.deformed = method in FRAMED and any(
            node.on != GROUND for node in self.nodes[self.frames : self.lumps.start]
        )
        self.ties = None if body.ties is None or not self.frames else body.ties
        for end in (0, 1) if self.ties is not None else ():
            t = self.ties
            for tie in range(len(t.stiffness)):
                fit = t.displacement[tie, end], t.rotation[tie, end]
                self.nodes.append(Node(int(t.frame[tie, end]), t.point[tie, end], *fit))

    def _frames(self):
        body = self.body
        if self.one and not body.floating:
            w = body.whole
            return [Node(GROUND, w.joint_point, w.joint_displacement, w.frame_rotation)]
        count = 1 if self.one else body.frame_count
        parent = list(body.frame_parent[:count])
        if self.method is Method.MODAL_ROTATION:
            parent = [GROUND if s == 0 or not body.floating else 0 for s in range(count)]
        data = zip(body.joint_point, body.joint_displacement, body.frame_rotation, strict=True)
        return [Node(int(p), *rest) for p, rest in zip(parent, data, strict=False)]

    def places(self, q):
        """Positions (K, 3) and rotations (K, 3, 3) of all nodes, (4) to (6), (19), (20) and section 4b."""
        position, rotation, share = [], [], TURNED.get(self.method)
        for number, node in enumerate(self.nodes):
            frame = number < self.frames
            parent = self.nodes[node.on] if node.on != GROUND else None
            u, turn = node.displacement @ q, node.rotation @ q
            if parent is None:
                base, carrier, theta = np.zeros(3), np.eye(3), np.zeros(3)
                offset = node.point + u
            else:
                base, carrier, theta = position[node.on], rotation[node.on], parent.rotation @ q
                arm = node.point - parent.point
                offset = arm + u - parent.displacement @ q - np.cross(theta, arm)
            relative = turn - theta
            if self.method is Method.SECOND_ORDER and self.frames:
                bent, twist = self._second_order(number, q, parent)
                offset, relative = offset + bent, relative + twist
            if share is not None:
                # Displacements turn, undeformed places do not; frames by a share of their rotation, and what they carry
                # by all that is left of its own.
                relative = (share * turn if frame else turn) - share * theta
                if parent is not None:
                    base, offset = base - parent.point + node.point, u - parent.displacement @ q
            position.append(base + carrier @ offset)
            rotation.append((self.turned if number == 0 else carrier) @ exponential(relative))
        return np.array(position), np.array(rotation)

    def _second_order(self, number, q, parent):
        """What (19) and (20) add to offset and relative rotation of a node."""
        second, node, lump = self.body.second, self.nodes[number], number - self.lumps.start
        if 0 <= lump < self.lumps.stop - self.lumps.start:
            # Seen from its frame a lump does not turn, and is bent by the coordinates whose inertia counts.
            q = q * (np.arange(q.size) < self.slow)
            w, z = (self.body.inertia.curvature[lump] @ q) @ q, None
        else:
            row = number if lump < 0 else number - self.lumps.stop + self.lumps.start
            w, z = ((given[row] @ q) @ q for given in (second.displacement, second.rotation))
        shift = self.shift(q)
        w = w + 2.0 * node.displacement @ shift
        z = None if z is None else z + 2.0 * node.rotation @ shift
        if parent is None:
            return 0.5 * w, 0.5 * z
        base, carrier = ((given[node.on] @ q) @ q for given in (second.displacement, second.rotation))
        base, carrier = base + 2.0 * parent.displacement @ shift, carrier + 2.0 * parent.rotation @ shift
        # Seen from the floating frame, which is the first.
        seen = self.nodes[0].rotation @ q if self.body.floating else np.zeros(3)
        theta, arm = parent.rotation @ q, node.point - parent.point
        change = (node.displacement - parent.displacement) @ q - np.cross(theta, arm)
        theta, turn = theta - seen, node.rotation @ q - seen
        bent = 0.5 * (w - base) - 0.5 * np.cross(carrier, arm) - np.cross(theta, change)
        bent = bent - 0.5 * np.cross(theta, np.cross(theta, arm))
        return bent, np.zeros(3) if z is None else 0.5 * (z - carrier) - 0.5 * np.cross(theta, turn)

    def shift(self, q):
        """Modal coordinates of the part of w that coordinates hold (section 4c): Σ t_r η_r, q + t η is free of it."""
        shift = np.zeros_like(q)
        for s, line, _ in zip(*self._stretches(), strict=True):
            shape = np.divide(np.sqrt(2.0) * line, self.stiffness, out=np.zeros(self.modes), where=self.stiffness > 0.0)
            shift = shift + np.sqrt(2.0) * (q @ s @ q) * shape
        return shift

    def _stretches(self):
        membrane = self.membrane
        return ((), (), ()) if membrane is None else (membrane.quadratic, membrane.linear, membrane.sign)

    def stretched(self, q):
        """V of section 4c."""
        found = [(q @ s @ q, line @ q, sign) for s, line, sign in zip(*self._stretches(), strict=True)]
        return sum(sign * ((bent + line) ** 2 - line**2) for bent, line, sign in found) if found else 0.0 * q[0]

    def _linear(self, inputs):
        """Modal force of loads on the undeformed body."""
        body, count = self.body, self.body.interface_count
        wrench = inputs[: 6 * count].reshape(-1, 2, 3)
        force = np.einsum("ic,icm->m", wrench[:, 0], body.interface_displacement)
        force = force + np.einsum("ic,icm->m", wrench[:, 1], body.interface_rotation)
        if body.masses is not None:
            force -= np.einsum("p,c,pcm->m", body.masses.mass, inputs[6 * count :], body.masses.displacement)
        return force

    def work(self, inputs, position):
        """J of (9): work of the loads' forces on nodes at (K, 3); without moments, which have no potential."""
        count = self.body.interface_count
        moved = position - np.array([node.point for node in self.nodes])
        done = np.sum(inputs[: 6 * count].reshape(-1, 2, 3)[:, 0] * moved[self.interfaces])
        if self.body.masses is not None:
            done = done - np.sum(self.body.masses.mass @ moved[self.masses] * inputs[6 * count :])
        return done

    def held(self, q):
        """E of (16): energy of the ties' springs."""
        position, rotation = self.places(q)
        ties, total = self.ties, 0.0
        count = len(ties.stiffness)
        for t in range(count):
            a, b = len(self.nodes) - 2 * count + t, len(self.nodes) - count + t
            gap = position[a] - position[b] - (ties.point[t, 0] - ties.point[t, 1])
            arms = (rotation[a] - rotation[b]) @ ties.lever[t]
            total = total + 0.5 * np.sum(ties.stiffness[t] * (gap**2 + np.sum(arms**2, axis=1)))
        return total

    def joined(self):
        """H of section 10: the ties' stiffness at rest. For small turns levers move by θ × l."""
        ties = self.ties
        u, turn = ties.displacement[:, 0] - ties.displacement[:, 1], ties.rotation[:, 0] - ties.rotation[:, 1]
        result = np.einsum("ti,tia,tib->ab", ties.stiffness, u, u)
        for c in range(3):
            arm = -np.einsum("tij,tja->tia", hat(ties.lever[:, :, c]), turn)
            result += np.einsum("ti,tia,tib->ab", ties.stiffness, arm, arm)
        return result

    def _moved(self, inputs, q):
        """Q of loads by the kinematics alone, (7) or (10), and of ties."""
        body, count = self.body, self.body.interface_count
        wrench = inputs[: 6 * count].reshape(-1, 2, 3)
        force = self._linear(inputs)
        if self.deformed:
            rotation = self.places(q)[1][self.interfaces].real
            moments = 0.5 * np.einsum("ijk,ikl->ijl", hat(wrench[:, 1]), rotation)

            def work(at):
                """J, and what has the virtual work of moments as its derivative here: m · ω = ½ m̂ R : Ṙ."""
                places = self.places(at)
                return self.work(inputs, places[0]) + np.sum(moments * places[1][self.interfaces])

            force = slopes(work, q)
        elif self.method in TURNED:
            moved = self.places(q)[0].real[self.interfaces] - body.interface_point
            force = force + np.einsum("ic,icm->m", np.cross(moved, wrench[:, 0]), body.interface_rotation)
        if self.ties is not None:
            force = force - slopes(self.held, q) + self.joined() @ q
        return force

    def _geometric(self, inputs, way):
        """Geometric stiffness of loads beyond what moving loads make by themselves (section 4b), times `way`."""
        if self.method not in (Method.STIFFNESS_BY_LOAD, Method.FRAMES_STIFFNESS):
            return np.zeros(self.modes)
        count, given = self.body.interface_count, self.body.stiffness_by_load
        wrench = inputs[: 6 * count].reshape(-1, 2, 3)
        ordered = np.concatenate([wrench[:, 0].ravel(), wrench[:, 1].ravel(), inputs[6 * count :]])
        own = difference(lambda q: self._moved(inputs, q), np.zeros(self.modes), way)
        return np.tensordot(ordered, given, axes=1) @ way + own

    def _by_mode(self, q):
        """Σ q_j K_j q of stiffness by mode."""
        if self.method is not Method.STIFFNESS_BY_MODE:
            return np.zeros(self.modes)
        return np.tensordot(q, self.body.stiffness_by_mode, axes=1) @ q

    def at(self, q):
        """The same body with its floating frame turned as q says, and coordinates that turn it no further."""
        if not self.rigid:
            return self, q
        now, motion = copy(self), np.concatenate([self.nodes[0].displacement, self.nodes[0].rotation])[:, : self.rigid]
        placed = motion @ q[: self.rigid]
        now.turned, placed[3:] = self.turned @ exponential(placed[3:]), 0.0
        return now, np.concatenate([np.linalg.solve(motion, placed), q[self.rigid :]])

    def force(self, inputs, q):
        """Q(q), (m,)."""
        now, q = self.at(q)
        return now._force(inputs, q)

    def _force(self, inputs, q):
        return self._moved(inputs, q) - self._geometric(inputs, q) - self._by_mode(q) - slopes(self.stretched, q)

    def tangent(self, inputs, q, way):
        """Λ − ∂Q/∂q times a direction, (m,)."""
        now, q = self.at(q)

        def moved(at):
            further, at = now.at(at)
            return further._moved(inputs, at) - further._by_mode(at) - slopes(further.stretched, at)

        slope = difference(moved, q, way)
        return self.stiffness * way - slope + self._geometric(inputs, way)

    def strain(self, q):
        """Strain energy, J."""
        energy = 0.5 * q @ (self.stiffness * q) + self.stretched(q)
        return energy if self.ties is None else energy + self.held(q) - 0.5 * q @ self.joined() @ q

    def mass(self, q):
        """M(q) of (12) and (13), from the lumps that the frames carry."""
        if not self.heavy:
            return np.eye(self.modes)
        now, place = self.at(q)
        change, slow = now._lumped(place) - self._lumped(np.zeros_like(q)), np.arange(self.modes) < self.slow
        return np.eye(self.modes) + change * np.outer(slow, slow)

    def _lumped(self, q):
        """What lumps and the frames that turn them have of the mass."""
        data = self.body.inertia
        rotation = self.places(q)[1].real
        motion = slopes(lambda at: self.places(at)[0], q)[self.lumps]
        spins = slopes(lambda at: self.places(at)[1], q)
        total = np.einsum("p,pia,pib->ab", data.mass, motion, motion)
        for s in range(self.frames):
            w = rotation[s].T @ np.array([axial(spins[s, :, :, j] @ rotation[s].T) for j in range(self.modes)]).T
            half = w.T @ (0.5 * data.turning[s] @ w + data.sweep[s])
            total += half + half.T
        return total


def difference(function, q, way):
    """Derivative along `way` of what is itself made by a complex step: extrapolated central differences."""
    size = np.sqrt(way @ way)
    if size == 0.0:
        return np.zeros_like(q)
    rows = []
    for k in range(6):
        h = 0.04 / 2.0**k / size
        rows.append([(function(q + h * way) - function(q - h * way)) / (2.0 * h)])
        for j in range(1, k + 1):
            rows[k].append(rows[k][j - 1] + (rows[k][j - 1] - rows[k - 1][j - 1]) / (4.0**j - 1.0))
    return rows[-1][-1]
