"""Which bone is which in the rigs at hand, written down by a person who looked at them."""

SIDES = ("left", "right")


def both_sides(left: dict[str, str], swap: tuple[str, str]) -> dict[str, str]:
    """Roles of both sides from the left one's names; `swap` turns a left name into a right one."""
    right = {role: bone.replace(*swap) for role, bone in left.items()}
    return {f"left_{role}": bone for role, bone in left.items()} | {
        f"right_{role}": bone for role, bone in right.items()
    }


MIXAMO = {
    "hips": "mixamorig:Hips", "neck": "mixamorig:Neck", "head": "mixamorig:Head",
    "spine": ("mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"),
    **both_sides({
        "clavicle": "mixamorig:LeftShoulder", "upper_arm": "mixamorig:LeftArm", "forearm": "mixamorig:LeftForeArm",
        "hand": "mixamorig:LeftHand", "thigh": "mixamorig:LeftUpLeg", "shin": "mixamorig:LeftLeg",
        "foot": "mixamorig:LeftFoot", "toe": "mixamorig:LeftToeBase",
    }, ("Left", "Right")),
}  # fmt: skip

CMU = {
    "hips": "Hips", "neck": "Neck", "head": "Head", "spine": ("LowerBack", "Spine", "Spine1"),
    **both_sides({
        "clavicle": "LeftShoulder", "upper_arm": "LeftArm", "forearm": "LeftForeArm", "hand": "LeftHand",
        "thigh": "LeftUpLeg", "shin": "LeftLeg", "foot": "LeftFoot", "toe": "LeftToeBase",
    }, ("Left", "Right")),
}  # fmt: skip

MAKEHUMAN = {
    "hips": "root", "neck": "neck01", "head": "head",
    "spine": ("spine05", "spine04", "spine03", "spine02", "spine01"),
    **both_sides({
        "clavicle": "clavicle.L", "upper_arm": "upperarm01.L", "forearm": "lowerarm01.L", "hand": "wrist.L",
        "thigh": "upperleg01.L", "shin": "lowerleg01.L", "foot": "foot.L",
    }, (".L", ".R")),
}  # fmt: skip

GAME_ENGINE = {
    "root": "Root", "hips": "pelvis", "neck": "neck_01", "head": "head", "spine": ("spine_01", "spine_02", "spine_03"),
    **both_sides({
        "clavicle": "clavicle_l", "upper_arm": "upperarm_l", "forearm": "lowerarm_l", "hand": "hand_l",
        "thigh": "thigh_l", "shin": "calf_l", "foot": "foot_l", "toe": "ball_l",
    }, ("_l", "_r")),
}  # fmt: skip

MANNEQUINY = {
    "hips": "pelvis", "neck": "neck_01", "head": "head", "spine": ("spine_01", "spine_02"),
    **both_sides({
        "clavicle": "clavicle.l", "upper_arm": "upperarm.l", "forearm": "lowerarm.l", "hand": "hand.l",
        "thigh": "thigh.l", "shin": "calf.l", "foot": "foot.l", "toe": "ball.l",
    }, (".l", ".r")),
}  # fmt: skip

# Its bone "Hips" carries the trunk but not the legs: the bone that carries both is "Body". The hand has no bone of its
# own, three palms leave the forearm. The feet hang on the root.
ROBOT = {
    "root": "Bone", "hips": "Body", "neck": "Neck", "head": "Head", "spine": ("Hips", "Abdomen", "Torso"),
    **both_sides({
        "clavicle": "Shoulder.L", "upper_arm": "UpperArm.L", "forearm": "LowerArm.L",
        "thigh": "UpperLeg.L", "shin": "LowerLeg.L", "foot": "Foot.L",
    }, (".L", ".R")),
}  # fmt: skip

METARIG = {
    "hips": "spine", "neck": "spine.004", "head": "spine.006", "spine": ("spine.001", "spine.002", "spine.003"),
    **both_sides({
        "clavicle": "shoulder.L", "upper_arm": "upper_arm.L", "forearm": "forearm.L", "hand": "hand.L",
        "thigh": "thigh.L", "shin": "shin.L", "foot": "foot.L", "toe": "toe.L",
    }, (".L", ".R")),
}  # fmt: skip

# The torso carries all; the chest's controls turn about the middle of the spine, those below hang upside down.
RIGIFY_FK = {
    "root": "root", "hips": "torso", "neck": "neck", "head": "head", "spine": ("spine_fk.002", "spine_fk.003"),
    **both_sides({
        "clavicle": "shoulder.L", "upper_arm": "upper_arm_fk.L", "forearm": "forearm_fk.L", "hand": "hand_fk.L",
        "thigh": "thigh_fk.L", "shin": "shin_fk.L", "foot": "foot_fk.L", "toe": "toe_fk.L",
    }, (".L", ".R")),
}  # fmt: skip

OF_FILES = {
    "mh_mixamo.glb": MIXAMO, "mh_mixamo.fbx": MIXAMO, "mh_vrm1.vrm": MIXAMO,
    "mh_cmu_mb.glb": CMU, "mh_cmu_mb.fbx": CMU,
    "mh_default.glb": MAKEHUMAN, "mh_default.fbx": MAKEHUMAN,
    "mh_game_engine.glb": GAME_ENGINE, "mh_game_engine.fbx": GAME_ENGINE,
    "mannequiny-0.3.0.glb": MANNEQUINY, "RobotExpressive.glb": ROBOT,
}  # fmt: skip
