"""What went wrong in programs of this kind, each with the test here that would notice.

The tests lie in their own rooms; this file only keeps them from being lost by renaming.
"""

import ast
from pathlib import Path

import pytest

HERE = Path(__file__).parent

TRAPS = {
    "slip compares frames that do not follow each other": (
        "energy/test_terms.py::test_slip_acts_only_between_consecutive_frames_that_are_both_in_contact",
    ),
    "contact is one-sided or without its range": (
        "energy/test_terms.py::test_contact_pulls_from_both_sides_and_only_from_within_reach",
        "energy/test_terms.py::test_the_papers_range_of_contact",
        "scene/test_contacts.py::test_contact_is_two_sided",
    ),
    "the body's depth has a bias": (
        "energy/test_terms.py::test_depth_by_hand_and_without_a_mask_no_term",
        "optimise/test_stages.py::test_true_depth_has_no_bias",
    ),
    "priors count once for each batch of frames": (
        "optimise/test_stages.py::test_the_scale_terms_do_not_depend_on_the_number_of_frames",
        "optimise/test_stages.py::test_depth_counts_as_a_few_measurements_whatever_the_length",
    ),
    "the one-euro filter is given absolute times": (
        "optimise/test_one_euro.py::test_late_frames_are_filtered_like_early_ones",
        "optimise/test_one_euro.py::test_noise_reduction_is_even_along_one_clip",
    ),
    "people who enter late are lost": (
        "test_pipeline.py::test_late_entrants_are_in_the_take_from_their_first_sight_on",
        "optimise/test_solve.py::test_frames_without_evidence_are_filled_without_a_jump",
    ),
    "people beyond 10 m are never reached": (
        "optimise/test_placement.py::test_exact_from_one_to_fifty_metres",
        "optimise/test_solve.py::test_far_and_near_people_both_get_their_place",
    ),
    "the depth range turns over or overflows": (
        "optimise/test_stages.py::test_near_is_always_nearer_than_far",
        "optimise/test_scale_ground.py::test_a_far_end_beyond_all_measure_stays_a_number",
    ),
    "an all-zero mask": ("optimise/test_solve.py::test_poor_evidence_gives_finite_answers",),
    "nobody in the first frame": ("optimise/test_solve.py::test_poor_evidence_gives_finite_answers",),
    "one person": ("optimise/test_solve.py::test_one_person_alone_is_of_average_height",),
    "portrait video and uneven focal lengths": (
        "optimise/test_pose_fit.py::test_any_lens_gives_the_same_pose_and_place",
        "optimise/test_solve.py::test_portrait_uneven_focal_lengths_and_distortion",
    ),
    "a jump": ("optimise/test_scale_ground.py::test_one_wild_frame_does_not_lift_the_ground",),
    "a person cut off by the border": ("optimise/test_solve.py::test_half_a_body_below_the_border",),
    "an unknown field of view goes unsaid": (
        "test_pipeline.py::test_an_assumed_field_of_view_is_announced_and_recorded",
    ),
    "motion terms shrink the scene": (
        "optimise/test_stages.py::test_motion_terms_do_not_shrink_the_scene",
        "optimise/test_solve.py::test_the_smaller_one_is_smaller_and_not_farther",
    ),
    "frames are taken by position instead of by number": (
        "test_pipeline.py::test_a_range_and_every_other_frame",
        "scene/test_aggregate.py::test_pictures_go_with_the_labels_of_their_own_frame",
    ),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_each_trap_is_watched(trap):
    for reference in TRAPS[trap]:
        path, _, name = reference.partition("::")
        functions = {
            node.name for node in ast.walk(ast.parse((HERE / path).read_text())) if isinstance(node, ast.FunctionDef)
        }
        assert name in functions, reference
