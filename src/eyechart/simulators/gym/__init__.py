"""Gymnasium environments with discrete actions that render RGB, driven by a user's action map."""

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

from eyechart.errors import SpecError, suggestion
from eyechart.simulators import Declaration, Drive
from eyechart.simulators.banks import versions_of
from eyechart.simulators.gym.action_map import ActionMap, read_map
from eyechart.simulators.gym.drive import GymnasiumDrive, action_count, make


class GymnasiumSimulator:
    """The simulator ``gym:ENV_ID``, which can be driven and makes no banks."""

    def __init__(self, env_id: str, action_map: ActionMap) -> None:
        self.declared = Declaration(
            name=f"gym:{env_id}",
            picture=action_map.picture,
            mirror_axis=action_map.mirror,
            action_space=action_map.space,
            scenarios={
                name: f"{env_id} as it is registered" + (f", with {dict(settings)}." if settings else ".")
                for name, settings in action_map.scenarios.items()
            },
            no_banks="eyechart cannot stage balanced moments in an unknown environment; save its pictures with their "
            "ground truth, and make a bank of them with 'eyechart frames import'",
        )
        self._env_id = env_id
        self._map = action_map
        self._package = ""
        for settings in action_map.scenarios.values():
            self._check(settings)

    def _check(self, settings: Mapping[str, object]) -> None:
        env = make(self._env_id, settings)
        try:
            start, count = action_count(env, self._env_id)
            self._package = type(env.unwrapped).__module__.partition(".")[0]
        finally:
            env.close()
        for action, number in self._map.numbers.items():
            if not start <= number < start + count:
                raise SpecError(
                    f"environment '{self._env_id}' has the actions {start} to {start + count - 1}, but the "
                    f"action map gives {action} the number {number}"
                )

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open the environment with this seed; raises SpecError for an unknown scenario."""
        if scenario not in self._map.scenarios:
            known = f"{', '.join(self._map.scenarios)}{suggestion(scenario, self._map.scenarios)}"
            raise SpecError(f"'{self.declared.name}' has no scenario '{scenario}'; known: {known}")
        return GymnasiumDrive(self._env_id, self._map, self._map.scenarios[scenario], seed)

    def versions(self) -> dict[str, str]:
        """Return the versions of Gymnasium and the environment's package, and the map's digest."""
        found = versions_of(("gymnasium", self._package.replace("_", "-"), "numpy"))
        return {**found, "action map": sha256(repr(self._map.as_dict()).encode()).hexdigest()[:16]}


def open_environment(env_id: str, actions: Path | None) -> GymnasiumSimulator:
    """Open ``gym:ENV_ID``; raises SpecError for an unsuitable environment or action map."""
    if not env_id:
        raise SpecError("name an environment, for example gym:CartPole-v1, or gym:highway_env:highway-v0 of a package")
    if actions is None:
        env = make(env_id, {})
        start, count = action_count(env, env_id)
        env.close()
        raise SpecError(
            f"'gym:{env_id}' needs an action map, --actions FILE.toml, that says what its actions "
            f"{start} to {start + count - 1} mean"
        )
    return GymnasiumSimulator(env_id, read_map(actions))
