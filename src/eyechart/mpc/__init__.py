"""A model-predictive controller for a kinematic bicycle: linearised, constrained, stateless, and exactly mirrored."""

from eyechart.mpc.controller import HORIZON, STEP_S, Bicycle, Mpc, Plan, Road, State, Target, Weights

__all__ = ["HORIZON", "STEP_S", "Bicycle", "Mpc", "Plan", "Road", "State", "Target", "Weights"]
