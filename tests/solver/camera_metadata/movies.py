"""MP4 and QuickTime files with known metadata, written box by box."""

import struct

APPLE_FOCAL = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
APPLE_LENS = "com.apple.quicktime.camera.lens_model"


def box(kind: bytes, *content: bytes) -> bytes:
    payload = b"".join(content)
    return struct.pack(">I4s", len(payload) + 8, kind) + payload


def large_box(kind: bytes, *content: bytes) -> bytes:
    """With a 64-bit size."""
    payload = b"".join(content)
    return struct.pack(">I4sQ", 1, kind, len(payload) + 16) + payload


def movie(*inside: bytes, media: int = 1000) -> bytes:
    """Brand, media, then the movie header with these boxes, as cameras write it."""
    return box(b"ftyp", b"qt  ") + box(b"mdat", bytes(media)) + box(b"moov", *inside)


def data(kind: int, value: bytes) -> bytes:
    return box(b"data", struct.pack(">II", kind, 0), value)


def keyed_meta(items: dict[str, bytes], *, is_full: bool = False) -> bytes:
    """QuickTime's `meta`: names in `keys`, values (`data` boxes) in `ilst`; with a version it is ISO's."""
    names = b"".join(struct.pack(">I4s", len(name) + 8, b"mdta") + name.encode() for name in items)
    values = b"".join(
        struct.pack(">II", len(value) + 8, number) + value for number, value in enumerate(items.values(), 1)
    )
    handler = box(b"hdlr", bytes(8), b"mdta", bytes(12))
    keys = box(b"keys", struct.pack(">II", 0, len(items)), names)
    return box(b"meta", bytes(4) if is_full else b"", handler, keys, box(b"ilst", values))


def exif(focal_mm: int, zoom: tuple[int, int] | None = None, make: str = "Maker", order: str = "<") -> bytes:
    """A TIFF block with the inner folder that holds the equivalent focal length."""
    inner_at, text_at, zoom_at = 64, 160, 200
    make_field = make.encode() + b"\0"
    tiff = bytearray(256)
    tiff[:8] = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    struct.pack_into(order + "HHHII", tiff, 8, 2, 0x010F, 2, len(make_field), text_at)
    struct.pack_into(order + "HHII", tiff, 22, 0x8769, 4, 1, inner_at)
    tiff[text_at : text_at + len(make_field)] = make_field
    struct.pack_into(order + "H", tiff, inner_at, 2 if zoom else 1)
    struct.pack_into(order + "HHIH", tiff, inner_at + 2, 0xA405, 3, 1, focal_mm)
    if zoom:
        struct.pack_into(order + "HHII", tiff, inner_at + 14, 0xA404, 5, 1, zoom_at)
        struct.pack_into(order + "II", tiff, zoom_at, *zoom)
    return b"Exif\0\0" + bytes(tiff)


def gopro_value(key: bytes, kind: bytes, value: bytes) -> bytes:
    return key + kind + struct.pack(">BH", len(value), 1) + value + bytes(-len(value) % 4)


def gopro_udta(degrees: float, mode: bytes) -> bytes:
    settings = gopro_value(b"ZFOV", b"f", struct.pack(">f", degrees)) + gopro_value(b"VFOV", b"c", mode)
    block = b"DEVC\0" + struct.pack(">BH", 1, len(settings)) + settings + bytes(-len(settings) % 4)
    return box(b"udta", box(b"GPMF", block))


def spatial_track(degrees: float, width: int, height: int) -> bytes:
    fields = bytearray(78)
    struct.pack_into(">HH", fields, 24, width, height)
    entry = box(b"hvc1", bytes(fields), box(b"hfov", struct.pack(">I", round(degrees * 1000))))
    table = box(b"stbl", box(b"stsd", struct.pack(">II", 0, 1), entry))
    return box(b"trak", box(b"mdia", box(b"minf", table)))
