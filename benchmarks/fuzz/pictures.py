"""Picture files of all kinds that are read, and of some that are not."""

import io
import random
import struct
import zlib
from pathlib import Path

from PIL import Image

from benchmarks.fuzz import some_bytes
from exosight.vision.pictures import decode_gray

SIDE = 24
_NUMBERS = (0, 1, 2, 8, 255, 256, 32_000, 65_535, 2**24, 2**31 - 1, 2**31, 2**32 - 1)


class Picture:
    """Pictures: decoded to gray."""

    def __init__(self, folder: Path) -> None:
        gray = Image.effect_noise((SIDE, SIDE), 60)
        colour = Image.merge("RGB", (gray, gray.rotate(90), gray.rotate(180)))
        exif = gray.getexif()
        exif[0x0112] = 6
        self._seeds = [
            *(
                _saved(image, "PNG")
                for image in (gray, colour, colour.convert("P"), gray.convert("1"), gray.convert("I;16"))
            ),
            _saved(colour.convert("RGBA"), "PNG", exif=exif),
            *(
                _saved(image, "JPEG", **options)
                for image in (gray, colour, colour.convert("CMYK"))
                for options in ({}, {"progressive": True, "exif": exif})
            ),
            *(
                _saved(image, "TIFF", compression=how)
                for image in (gray, colour, gray.convert("I;16"))
                for how in ("raw", "tiff_lzw", "tiff_adobe_deflate", "packbits")
            ),
            *(
                _saved(gray.convert("1"), "TIFF", compression=how)
                for how in ("group3", "group4", "tiff_ccitt")
            ),
            *(
                _saved(colour, "TIFF", compression="jpeg"),
                _saved(colour, "WEBP"),
                _saved(colour, "WEBP", lossless=True),
            ),
            *(_saved(image, "BMP") for image in (gray, colour, gray.convert("1"), colour.convert("P"))),
            *(_saved(colour, kind) for kind in ("GIF", "PPM", "TGA", "ICO", "PCX", "JPEG2000")),
        ]

    def __call__(self, draw: random.Random) -> None:
        """One picture."""
        decode_gray(self.content(draw), "picture", SIDE, SIDE, draw.choice((None, None, None, (0, 0, 8))))

    def content(self, draw: random.Random) -> bytes:
        """A file."""
        content = draw.choice(self._seeds)
        for _ in range(draw.choice((1, 1, 2))):
            content = draw.choice((some_bytes, _number, _mended, _spliced))(content, draw)
        if draw.random() < 0.02:
            content = content[:8] + draw.choice(self._seeds)
        return content


def _saved(image: Image.Image, kind: str, **options: object) -> bytes:
    image.save(content := io.BytesIO(), kind, **options)
    return content.getvalue()


def _number(content: bytes, draw: random.Random) -> bytes:
    """Another number of two or four bytes, mostly in the head, where sizes and offsets are."""
    at = draw.randrange(1 + min(len(content), draw.choice((32, 256, 10_000))))
    form = draw.choice(("<H", ">H", "<I", ">I"))
    new = struct.pack(form, draw.choice(_NUMBERS) % 2 ** (8 * struct.calcsize(form)))
    return content[:at] + new + content[at + len(new) :]


def _spliced(content: bytes, draw: random.Random) -> bytes:
    """A part of it in another place."""
    a, b, c = sorted(draw.randrange(len(content)) for _ in range(3)) if content else (0, 0, 0)
    return content[:a] + content[b:c] + content[a:]


def _mended(content: bytes, draw: random.Random) -> bytes:
    """Bytes of one block of a PNG changed, its checksum right again; other kinds as by `some_bytes`."""
    if not content.startswith(b"\x89PNG"):
        return some_bytes(content, draw)
    found, at, blocks = content[:8], 8, []
    while at + 12 <= len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        blocks.append(content[at + 4 : at + 8 + length])
        at += 12 + length
    chosen = draw.randrange(len(blocks)) if blocks else -1
    for i, block in enumerate(blocks):
        body = block
        if i == chosen:
            unpack = block.startswith(b"IDAT") and draw.random() < 0.5
            body = block[:4] + some_bytes(block[4:], draw)
            if unpack:
                body = b"IDAT" + zlib.compress(bytes(draw.choice((0, 100, 10**6))), 9)
        found += struct.pack(">I", max(0, len(body) - 4)) + body + struct.pack(">I", zlib.crc32(body))
    return found
