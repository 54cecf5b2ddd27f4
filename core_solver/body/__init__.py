"""Body models: the open default and the user's own SMPL files, skinning and kinematics."""
