"""Published controllers by their shape: how each is asked, and how it answers; a picture's code chooses the answer."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """A controller: its prompt file, its reply to a code from 0, and the action that the reply means."""

    prompt: str
    reply: Callable[[int], str]
    action: Callable[[int], str]


_IDS = '["0", "1", "2", "3", "4"]'
_STEER = ("Left", "Slight left", "None", "Slight right", "Right")
_QUESTION = "What are safe actions of the ego vehicle?"
_VIEWPOINTS = tuple(f"{17 * n:02x}" * 16 for n in (3, 9, 12))

PUBLISHED = {
    "DiLu": Published(
        f"""
user = "Choose 0 turn-left, 1 idle, 2 turn-right, 3 acceleration or 4 deceleration."
[[answer.fields]]
name = "action"
pattern = 'Response to user:\\s*#+\\s*(-?\\d+)'
values = {_IDS}
brake = ["4"]
proceed = ["1", "3"]
mirror_pairs = [["0", "2"]]
""",
        lambda n: (
            f"Reasoning: the lead is 12 m away, speed 3.\nFinal Answer: Deceleration\nResponse to user:#### {n % 5}"
        ),
        lambda n: str(n % 5),
    ),
    "NavGPT": Published(
        """
user = "Viewpoints: {viewpoints}. Choose one."
[answer]
fields = [{name = "viewpoint", pattern = 'Action Input:[ "]*([0-9a-f]{32})', from_column = "viewpoints"}]
""",
        lambda n: f'Thought: I should go on.\nAction: action_maker\nAction Input: "{_VIEWPOINTS[n % 3]}"',
        lambda n: _VIEWPOINTS[n % 3],
    ),
    "RC car": Published(
        """
user = "A: turn left. B: ahead. C: turn right. Answer with a letter."
[action_space]
actions = ["A", "B", "C"]
mirror_pairs = [["A", "C"]]
proceed = ["A", "B", "C"]
[answer]
fields = [{name = "letter"}]
""",
        lambda n: f"Action: {'ABC'[n % 3]}",
        lambda n: "ABC"[n % 3],
    ),
    "two indices": Published(
        """
user = "Trajectories 0, 1, 2 from left to right; speeds 0, 1, 2 from slow to fast."
[answer]
fields = [
  {name = "trajectory", key = "trajectory_index", values = ["0", "1", "2"], mirror_pairs = [["0", "2"]]},
  {name = "speed", key = "speed_index", values = ["0", "1", "2"], brake = ["0"], proceed = ["1", "2"]},
]
""",
        lambda n: f'```json\n{{"trajectory_index": {n % 3}, "speed_index": {n // 3 % 3}}}\n```',
        lambda n: f"trajectory={n % 3} speed={n // 3 % 3}",
    ),
    "DriveLM": Published(
        f"""
user = "{_QUESTION} Answer with keep, brake or turn."
[[answer.fields]]
name = "action"
pattern = 'A: The action is to (\\w+)'
values = ["keep", "brake", "turn"]
brake = ["brake"]
proceed = ["keep"]
""",
        lambda n: f"Q: {_QUESTION} A: The action is to {('keep', 'brake', 'turn')[n % 3]}.",
        lambda n: ("keep", "brake", "turn")[n % 3],
    ),
    "VLMnav": Published(
        """
user = "The arrows {arrows} are drawn. Reply as {{'action': n}}."
[answer]
fields = [{name = "arrow", key = "action", from_column = "arrows"}]
""",
        lambda n: ("{'action': %d}" if n % 2 else 'Arrow it is.\n{"action": %d}') % (2 + n % 3),
        lambda n: str(2 + n % 3),
    ),
    "LimSim++": Published(
        """
user = "Choose IDLE, ACCELERATE, DECELERATE or STOP, under a heading."
[action_space]
actions = ["IDLE", "ACCELERATE", "DECELERATE", "STOP"]
brake = ["STOP", "DECELERATE"]
proceed = ["IDLE", "ACCELERATE"]
[answer]
fields = [{name = "decision", pattern = '(?m)^## Decision\\s+(\\w+)$'}]
""",
        lambda n: f"## Description\nA car stops ahead.\n## Decision\n{('IDLE', 'DECELERATE', 'STOP')[n % 3]}",
        lambda n: ("IDLE", "DECELERATE", "STOP")[n % 3],
    ),
    "llm-carla": Published(
        """
user = "Throttle: Increase, Keep or Decrease. Steer: Left, Slight left, None, Slight right, Right. Brake: None or Full."
[[answer.fields]]
name = "throttle"
pattern = 'Throttle: (\\w+)'
values = ["Increase", "Keep", "Decrease"]
brake = ["Decrease"]
proceed = ["Increase", "Keep"]
[[answer.fields]]
name = "steer"
pattern = 'Steer: ([\\w ]+?) *(?:/|$)'
values = ["Left", "Slight left", "None", "Slight right", "Right"]
mirror_pairs = [["Left", "Right"], ["Slight left", "Slight right"]]
[[answer.fields]]
name = "brake"
pattern = 'Brake: (\\w+)'
values = ["Full", "None"]
brake = ["Full"]
""",
        lambda n: f"Throttle: Increase / Steer: {_STEER[n % 5]} / Brake: {('None', 'Full')[n % 2]}",
        lambda n: f"throttle=Increase steer={_STEER[n % 5]} brake={('None', 'Full')[n % 2]}",
    ),
    "velocity": Published(
        """
user = "Reply with vx in m/s and the yaw rate in rad/s as JSON."
[[answer.fields]]
name = "vx"
kind = "number"
key = "cmd.vx"
unit = "m/s"
values = ["<= 0", "< 0.5", ">= 0.5"]
brake = ["<= 0", "< 0.5"]
proceed = [">= 0.5"]
[[answer.fields]]
name = "yaw"
kind = "number"
key = "cmd.wz"
values = ["< -0.1", "-0.1..0.1", "> 0.1"]
mirror_pairs = [["< -0.1", "> 0.1"]]
""",
        lambda n: f'{{"cmd": {{"vx": {n % 5 / 4}, "wz": {n % 3 - 1}}}}}',
        lambda n: f"vx{('<=0', '<0.5', '>=0.5', '>=0.5', '>=0.5')[n % 5]} yaw{('<-0.1', '=-0.1..0.1', '>0.1')[n % 3]}",
    ),
    "LightEMMA": Published(
        """
user = "Predict six pairs of speed and curvature."
[answer]
fields = [{name = "pairs", kind = "vector", size = 12}]
""",
        lambda n: str([(n % 4, 0.01)] * 6),
        lambda n: f"pairs=[{', '.join([f'{n % 4}, 0.01'] * 6)}]",
    ),
}
"""By name. The columns ``viewpoints`` and ``arrows`` hold the names that a frame allows."""

COLUMNS = {"viewpoints": ", ".join(_VIEWPOINTS), "arrows": "2, 3, 4"}
