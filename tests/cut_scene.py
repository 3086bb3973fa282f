"""Scenes of which a test runs a part."""

from dataclasses import replace

from msgspec import structs

from hhsim.scene.body import Body, Driven
from hhsim.scene.scene import Hand, Scene


def cut(scene: Scene, bodies: slice) -> Scene:
    """Return the first ticks of the hands beside bodies that move from their places as in other ticks."""
    cut_bodies = []
    for body in scene.bodies:
        if isinstance(body, Body) and isinstance(body.motion, Driven):
            poses, values = body.motion.poses.at(bodies), body.motion.values
            motion = Driven(poses, None if values is None else values[bodies])
            joint = body.joint
            if joint is not None and values is not None:
                joint = structs.replace(joint, start=float(values[bodies][0]))
            body = replace(body, motion=motion, joint=joint)
        cut_bodies.append(body)
    count = len(range(*bodies.indices(scene.ticks.tick_count)))
    hands = tuple(replace(hand, ticks=hand.ticks.first(count)) for hand in scene.hands)
    description = {**scene.description, "trajectory": f"{scene.description.get('trajectory')}, cut"}
    return replace(scene, hands=hands, bodies=tuple(cut_bodies), description=description)


def of_hand(scene: Scene, hand: int) -> Scene:
    """Return a scene of two hands with one of them."""
    return replace(scene, hands=(scene.hands[hand],))


def moved_hand(scene: Scene, hand: int, **changed: object) -> Scene:
    """Return a scene with other arrays of the ticks of a hand."""
    hands: list[Hand] = list(scene.hands)
    hands[hand] = replace(hands[hand], ticks=replace(hands[hand].ticks, **changed))  # type: ignore[arg-type]
    return replace(scene, hands=tuple(hands))
