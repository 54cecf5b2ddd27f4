"""The fused operator as Warp kernels: one thread a vertex, a face or a pixel; the geometry is told in the numba files.

A pixel's KEY holds 1/z of the nearest face in its upper half and, so that ties go to the first face as on the CPU, the
complement of the face's index in its lower half: larger is nearer, and 0 means that nothing was drawn.
"""

# Warp compiles these functions from their sources, in a language that looks like Python but is not typed like it.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportOperatorIssue=false
# pyright: reportAssignmentType=false, reportIndexIssue=false, reportArgumentType=false
# ruff: noqa: SIM102

import warp as wp

_NEAR = wp.constant(0.05)
_FAR_OUT = wp.constant(1.0e6)
_EDGE_ON = wp.constant(1.0e-4)
_INSIDE = wp.constant(-1.0e-5)
_MARGIN = wp.constant(0.05)
_NOBODY = wp.constant(-1)
_UNKNOWN = wp.constant(-2)

# Slopes are written out below; Warp need not derive its own.
wp.set_module_options({"enable_backward": False})


@wp.kernel
def project(vertices: wp.array2d(dtype=wp.vec3), lens: wp.vec4, screen: wp.array2d(dtype=wp.vec3)):
    """Raster x, y and 1/z; NaN for vertices that cannot be drawn."""
    body, i = wp.tid()
    vertex = vertices[body, i]
    inverse = 1.0 / vertex[2]
    x = lens[0] * vertex[0] * inverse + lens[2]
    y = lens[1] * vertex[1] * inverse + lens[3]
    screen[body, i] = wp.vec3(wp.nan, wp.nan, wp.nan)
    if vertex[2] >= _NEAR and inverse > 0.0 and wp.abs(x) < _FAR_OUT and wp.abs(y) < _FAR_OUT:
        screen[body, i] = wp.vec3(x, y, inverse)


@wp.func
def cross(ax: float, ay: float, bx: float, by: float):
    """Twice the area between two vectors of the picture."""
    return ax * by - ay * bx


@wp.func
def barycentric(a: wp.vec3, b: wp.vec3, c: wp.vec3, x: float, y: float):
    """Shares of a face's corners at a point of the picture."""
    area = cross(b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1])
    first = cross(b[0] - x, b[1] - y, c[0] - x, c[1] - y) / area
    second = cross(c[0] - x, c[1] - y, a[0] - x, a[1] - y) / area
    return wp.vec3(first, second, 1.0 - first - second)


@wp.kernel
def draw(screen: wp.array2d(dtype=wp.vec3), faces: wp.array(dtype=wp.vec3i), keys: wp.array3d(dtype=wp.uint64)):
    """Leave in each pixel the key of the nearest face that looks at the camera."""
    body, f = wp.tid()
    face = faces[f]
    a, b, c = screen[body, face[0]], screen[body, face[1]], screen[body, face[2]]
    area = cross(b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1])
    if not (area < 0.0):
        return
    low, high = wp.min(wp.min(a, b), c), wp.max(wp.max(a, b), c)
    width, height = high[0] - low[0], high[1] - low[1]
    if -area < _EDGE_ON * (width * width + height * height):
        return
    x0, x1 = wp.max(0, int(wp.ceil(low[0]))), wp.min(keys.shape[2] - 1, int(wp.floor(high[0])))
    y0, y1 = wp.max(0, int(wp.ceil(low[1]))), wp.min(keys.shape[1] - 1, int(wp.floor(high[1])))
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            share = barycentric(a, b, c, float(x), float(y))
            if share[0] >= _INSIDE and share[1] >= _INSIDE and share[2] >= _INSIDE:
                inverse = share[0] * a[2] + share[1] * b[2] + share[2] * c[2]
                key = (wp.uint64(wp.cast(inverse, wp.uint32)) << wp.uint64(32)) | (wp.uint64(0xFFFFFFFF) - wp.uint64(f))
                wp.atomic_max(keys, body, y, x, key)


@wp.func
def inverse_depth(key: wp.uint64):
    """1/z of a drawn pixel."""
    return wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)


@wp.func
def depth_or(key: wp.uint64, otherwise: float):
    """Depth of a drawn pixel, or a default."""
    if key == wp.uint64(0):
        return otherwise
    return 1.0 / inverse_depth(key)


@wp.kernel
def cost_by_masks(
    masks: wp.array3d(dtype=wp.uint8), visible: wp.array3d(dtype=wp.uint8), cost: wp.array3d(dtype=wp.int8)
):
    """-1 in the mask, 1 beside it, 0 where nothing is known."""
    body, y, x = wp.tid()
    if visible[body, y, x] == wp.uint8(0):
        cost[body, y, x] = wp.int8(0)
    elif masks[body, y, x] != wp.uint8(0):
        cost[body, y, x] = wp.int8(-1)
    else:
        cost[body, y, x] = wp.int8(1)


@wp.kernel
def add_depths(screen: wp.array2d(dtype=wp.vec3), sums: wp.array(dtype=wp.float64), counts: wp.array(dtype=wp.int32)):
    """Sum of depths over each body's drawable vertices, and their number."""
    body, i = wp.tid()
    inverse = screen[body, i][2]
    if inverse > 0.0:
        wp.atomic_add(sums, body, wp.float64(1.0 / inverse))
        wp.atomic_add(counts, body, 1)


@wp.func
def mean_depth(sums: wp.array(dtype=wp.float64), counts: wp.array(dtype=wp.int32), body: int):
    """Mean depth of a body; -inf if it could not be drawn: it may be anywhere."""
    if counts[body] == 0:
        return -wp.inf
    return float(sums[body] / wp.float64(counts[body]))


@wp.kernel
def cost_by_labels(
    labels: wp.array3d(dtype=wp.uint8),
    owners: wp.array(dtype=wp.int32),
    people: int,
    keys: wp.array3d(dtype=wp.uint64),
    sums: wp.array(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
    cost: wp.array3d(dtype=wp.int8),
):
    """As `people.fill_cost`; the bodies of a frame follow one another."""
    body, y, x = wp.tid()
    first = (body // people) * people
    owner = owners[int(labels[body // people, y, x])]
    depth = depth_or(keys[body, y, x], mean_depth(sums, counts, body))
    here = wp.int32(1)
    if owner == body - first:
        here = -1
    elif owner == _UNKNOWN:
        here = 0
    elif owner != _NOBODY:
        if mean_depth(sums, counts, first + owner) + _MARGIN < depth:
            here = 0
    for other in range(first, first + people):
        if other != body and depth_or(keys[other, y, x], wp.inf) + _MARGIN < depth:
            here = 0
    cost[body, y, x] = wp.int8(here)


@wp.func
def pull(
    keys: wp.array3d(dtype=wp.uint64), cost: wp.array3d(dtype=wp.int8), body: int, y: int, x: int, dy: int, dx: int
):
    """Slope of the number of wrong pixels when the outline towards one neighbour moves that way."""
    if y + dy < 0 or y + dy >= keys.shape[1] or x + dx < 0 or x + dx >= keys.shape[2]:
        return 0.0
    if keys[body, y + dy, x + dx] != wp.uint64(0):
        return 0.0
    return 0.5 * float(int(cost[body, y, x]) + int(cost[body, y + dy, x + dx]))


@wp.kernel
def shade(
    screen: wp.array2d(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    keys: wp.array3d(dtype=wp.uint64),
    cost: wp.array3d(dtype=wp.int8),
    logs: wp.array(dtype=wp.float64),
    pixels: wp.array(dtype=wp.int32),
    claimed: wp.array(dtype=wp.int32),
    costs: wp.array(dtype=wp.int32),
    depth_slopes: wp.array2d(dtype=wp.vec3),
    outline_slopes: wp.array2d(dtype=wp.vec3),
):
    """As `shading.shade`, one pixel."""
    body, y, x = wp.tid()
    here = int(cost[body, y, x])
    if here < 0:
        wp.atomic_add(claimed, body, 1)
    key = keys[body, y, x]
    if key == wp.uint64(0):
        return
    wp.atomic_add(costs, body, here)
    across = pull(keys, cost, body, y, x, 0, 1) - pull(keys, cost, body, y, x, 0, -1)
    down = pull(keys, cost, body, y, x, 1, 0) - pull(keys, cost, body, y, x, -1, 0)
    if here >= 0 and across == 0.0 and down == 0.0:
        return
    face = faces[int(wp.uint64(0xFFFFFFFF) - (key & wp.uint64(0xFFFFFFFF)))]
    a, b, c = screen[body, face[0]], screen[body, face[1]], screen[body, face[2]]
    share = barycentric(a, b, c, float(x), float(y))
    if here < 0:
        inverse = inverse_depth(key)
        wp.atomic_add(logs, body, wp.float64(-wp.log(inverse)))
        wp.atomic_add(pixels, body, 1)
        area = cross(b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1])
        along_x = ((b[1] - c[1]) * (a[2] - c[2]) + (c[1] - a[1]) * (b[2] - c[2])) / area
        along_y = ((c[0] - b[0]) * (a[2] - c[2]) + (a[0] - c[0]) * (b[2] - c[2])) / area
        slope = wp.vec3(along_x, along_y, -1.0) / inverse
        for corner in range(3):
            wp.atomic_add(depth_slopes, body, face[corner], share[corner] * slope)
    if across != 0.0 or down != 0.0:
        for corner in range(3):
            wp.atomic_add(outline_slopes, body, face[corner], share[corner] * wp.vec3(across, down, 0.0))


@wp.kernel
def to_camera_frame(
    vertices: wp.array2d(dtype=wp.vec3),
    screen: wp.array2d(dtype=wp.vec3),
    lens: wp.vec4,
    amounts: wp.array(dtype=wp.int32),
    slopes: wp.array2d(dtype=wp.vec3),
):
    """Turn raster slopes of a sum, in place, into slopes of a mean over so many pixels by vertices in metres."""
    body, i = wp.tid()
    vertex, inverse, slope = vertices[body, i], screen[body, i][2], slopes[body, i]
    by_metre = wp.vec3(0.0, 0.0, 0.0)
    if inverse > 0.0 and amounts[body] > 0:
        across, down = slope[0] * lens[0], slope[1] * lens[1]
        towards = -(across * vertex[0] + down * vertex[1] + slope[2]) * inverse
        by_metre = wp.vec3(across, down, towards) * (inverse / float(amounts[body]))
    slopes[body, i] = by_metre
