"""Soft and rigid multibody mechanics from one scalar: the potential energy of a kinematic tree.

basis, quadrature, section   components of a rod: strain functions, points, stiffness
joint, link, rod, robot      bodies and their tree
kinematics                   forward kinematics of the tree: poses, Jacobians; pull-back of wrenches
energy                       the potential: elasticity, joint limits, sum of the terms
contact, actuation           contact of spheres; pressure and cables along a line
surfaces                     tubes around rods, tapered solids, planes
surface_contact              contact of rods' tubes with links and planes; tube_contact with each other
rigid_contact, cones         contact of links with links and planes, by their closest spheres
friction                     Coulomb friction of any of these, with a memory of where points stuck
contact_damping              damping of any of these in motions, after Hunt and Crossley
relaxation                   viscoelastic rods: Prony series, with a memory of internal strains
loads, bushing               weight, wrenches, distributed forces, torques; springs that close loops
equilibrium                  stable minima of the energy: options and results
quasistatic                  the driver: states under slowly changing loads, many robots at a time
dynamics                     motion in time: equation_of_motion, stepped by timestep
"""

from exosight.mechanics.actuation import PressureLine, helix, straight
from exosight.mechanics.basis import (
    Chebyshev,
    Fourier,
    Gaussian,
    Hermite,
    Legendre,
    Monomial,
    NodalCubic,
    NodalLinear,
    NodalQuadratic,
)
from exosight.mechanics.batched_continuation import Snap
from exosight.mechanics.bushing import Bushing
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.dynamics import MotionOptions, Trajectories, evolve
from exosight.mechanics.energy import potential
from exosight.mechanics.equilibrium import Equilibria, SolverOptions, stack
from exosight.mechanics.joint import (
    Cylindrical,
    Fixed,
    Free,
    Helical,
    Joint,
    Planar,
    Prismatic,
    Revolute,
    Spherical,
    Universal,
)
from exosight.mechanics.kinematics import Motion, walk
from exosight.mechanics.link import Link
from exosight.mechanics.loads import DeadForce, DistributedForce, Gravity, JointTorque, PointWrench
from exosight.mechanics.quadrature import Gauss
from exosight.mechanics.quasistatic import State, advance, drive, initial_state, locate_snaps
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.section import Circular, Elliptic, Rectangular, Section
from exosight.mechanics.sensitivity import differentiable
from exosight.mechanics.term import Configuration, Term

__all__ = [
    "Bushing",
    "Chebyshev",
    "Circular",
    "Configuration",
    "Cylindrical",
    "DeadForce",
    "DistributedForce",
    "Elliptic",
    "Equilibria",
    "Fixed",
    "Fourier",
    "Free",
    "Gauss",
    "Gaussian",
    "Gravity",
    "Helical",
    "Hermite",
    "Joint",
    "JointTorque",
    "Legendre",
    "Link",
    "Monomial",
    "Motion",
    "MotionOptions",
    "NodalCubic",
    "NodalLinear",
    "NodalQuadratic",
    "Planar",
    "PointWrench",
    "PressureLine",
    "Prismatic",
    "Rectangular",
    "Revolute",
    "Robot",
    "Rod",
    "Section",
    "Snap",
    "SolverOptions",
    "SphereContact",
    "Spherical",
    "State",
    "Term",
    "Trajectories",
    "Universal",
    "advance",
    "differentiable",
    "drive",
    "evolve",
    "helix",
    "initial_state",
    "locate_snaps",
    "potential",
    "stack",
    "straight",
    "walk",
]
