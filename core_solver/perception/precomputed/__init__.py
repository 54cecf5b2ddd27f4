"""What other programs have already seen: joints, SMPL poses, depth and masks read from a folder of files."""
