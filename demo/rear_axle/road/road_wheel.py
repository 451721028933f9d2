"""A wheel on a road with a bump, an FMU by pythonfmu alone: mass and tyre, point contact.

The wheel's centre moves by the force at its hub, its weight and the forces of the tyre,

    m ẍ = f_x,   m ÿ = f_y + F_y,   m z̈ = f_z − m g + F_z,
    F_z = max(0, F₀ + k (r − z) + d (ṙ − ż)),   σ/v Ḟ_y + F_y = −c F_z (ψ + ẏ / v),

where r(t) is the road's height under it, a bump ½ h (1 − cos 2πs/L) on a flat road at the travelling speed v, ψ the
wheel's turn about the vertical, the bracket its slip angle and σ the tyre's relaxation length. The side force acts at
the road: its moment about the hub goes out, for whoever bears the hub. Displacements count from the place where a tyre
that stands on the flat road bears F₀. What is left out: the length of contact, the self-aligning moment, forces along
the road, the wheel's inertia against turning.
"""

import copy
import ctypes
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

# The library gives up a reference to this namespace that it only borrowed.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))

GRAVITY = 9.81

# SI units.
PARAMETERS = {
    "mass": 20.0,
    "tyre.stiffness": 200e3,
    "tyre.damping": 300.0,
    "tyre.preload": 3000.0,
    "tyre.cornering": 12.0,
    "tyre.radius": 0.3,
    "tyre.relaxation": 0.3,
    "road.speed": 8.0,
    "bump.start": 0.0,
    "bump.length": 0.5,
    "bump.height": 0.0,
}
AXES = ("x", "y", "z")
ROWS, COLUMNS = ("ux", "uy", "uz", "rx", "ry", "rz"), ("fx", "fy", "fz", "mx", "my", "mz")
# Runge-Kutta step, s: a fortieth of a radian of the wheel's swing on its tyre.
LONGEST = 2.5e-4


class RoadWheel(Fmi2Slave):
    """The wheel."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.values = dict(PARAMETERS)
        self.place, self.speed, self.force = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self.time, self.step, self.steer, self.side = 0.0, 0.0, 0.0, 0.0
        for name in PARAMETERS:
            self.offer(name, "parameter", lambda name=name: self.values[name], lambda x, name=name: self.set(name, x))
        for i, axis in enumerate(AXES):
            self.offer(f"hub.force.{axis}", "input", lambda i=i: self.force[i], lambda x, i=i: self.push(i, x))
            self.offer(f"hub.displacement.{axis}", "output", lambda i=i: self.place[i])
            self.offer(f"hub.velocity.{axis}", "output", lambda i=i: self.speed[i])
        self.offer("steer", "input", lambda: self.steer, lambda x: setattr(self, "steer", x))
        self.offer("tyre.force", "output", lambda: self.tyre(self.time, self.place[2], self.speed[2]))
        self.offer("tyre.side_force", "output", lambda: self.side)
        self.offer("tyre.moment.x", "output", lambda: self.values["tyre.radius"] * self.side)
        self.offer("road.height", "output", lambda: self.road(self.time)[0])
        # What a master that iterates may ask: the motion at a step's end by a force held over it.
        for i, row in enumerate(ROWS):
            for j, column in enumerate(COLUMNS):
                self.offer(f"hub.compliance.{row}.{column}", "local", lambda give=i == j < 3: self.compliance(give))

    def offer(self, name, causality, getter, setter=None):
        """Register a Real variable."""
        fixed = causality == "parameter"
        self.register_variable(
            Real(
                name,
                causality=Fmi2Causality[causality],
                variability=Fmi2Variability.fixed if fixed else Fmi2Variability.continuous,
                start=0.0 if causality == "input" else None,
                getter=getter,
                setter=setter or (lambda value: None),  # noqa: ARG005
            ),
            nested=False,
        )

    def set(self, name, value):
        """Set a parameter."""
        self.values[name] = value

    def push(self, axis, value):
        """Set a component of the force at the hub."""
        self.force[axis] = value

    def compliance(self, give):
        """Displacement by a force held over a step, of the mass alone: the tyre is soft within one."""
        return 0.5 * self.step**2 / self.values["mass"] if give else 0.0

    def road(self, time):
        """Height of the road under the wheel, m, and how fast it grows, m/s."""
        p = self.values
        s = p["road.speed"] * time - p["bump.start"]
        if not 0.0 < s < p["bump.length"]:
            return 0.0, 0.0
        phase = 2.0 * math.pi / p["bump.length"]
        slope = 0.5 * p["bump.height"] * phase * math.sin(phase * s)
        return 0.5 * p["bump.height"] * (1.0 - math.cos(phase * s)), slope * p["road.speed"]

    def tyre(self, time, height, speed):
        """Force of the tyre, upwards, N: it does not pull."""
        p, (road, growth) = self.values, self.road(time)
        force = p["tyre.preload"] + p["tyre.stiffness"] * (road - height) + p["tyre.damping"] * (growth - speed)
        return max(0.0, force)

    def rates(self, time, state):
        """Rates of (y, z, ẏ, ż, F_y)."""
        _, height, sideways, speed, side = state
        p, up = self.values, self.tyre(time, height, speed)
        wanted = -p["tyre.cornering"] * up * (self.steer + sideways / p["road.speed"])
        return (
            sideways,
            speed,
            (self.force[1] + side) / p["mass"],
            (self.force[2] + up) / p["mass"] - GRAVITY,
            (wanted - side) * p["road.speed"] / p["tyre.relaxation"],
        )

    def do_step(self, current_time, step_size):
        """Advance by Runge-Kutta; exactly along the road."""
        pull, self.step = self.force[0] / self.values["mass"], step_size
        self.place[0] += self.speed[0] * step_size + 0.5 * pull * step_size**2
        self.speed[0] += pull * step_size
        count = math.ceil(step_size / LONGEST)
        h, state = step_size / count, (*self.place[1:], *self.speed[1:], self.side)
        for k in range(count):
            t = current_time + k * h
            a = self.rates(t, state)
            b = self.rates(t + h / 2, [x + h / 2 * r for x, r in zip(state, a, strict=True)])
            c = self.rates(t + h / 2, [x + h / 2 * r for x, r in zip(state, b, strict=True)])
            d = self.rates(t + h, [x + h * r for x, r in zip(state, c, strict=True)])
            state = [x + h / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(state, a, b, c, d, strict=True)]
        self.place[1:], self.speed[1:], self.side = state[:2], state[2:4], state[4]
        self.time = current_time + step_size
        return True

    def _get_fmu_state(self):
        names = ("place", "speed", "force", "time", "step", "steer", "side", "values")
        return {name: copy.copy(getattr(self, name)) for name in names}

    def _set_fmu_state(self, state):
        for name, value in state.items():
            setattr(self, name, copy.copy(value))
