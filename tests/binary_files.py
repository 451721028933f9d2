"""What a compiled library needs and offers, read from its bytes: ELF, PE and Mach-O, 64 bit, little-endian."""

import hashlib
import struct
from dataclasses import dataclass, field

X86, ARM = "x86-64", "arm64"


@dataclass
class Library:
    machine: str
    needed: set[str] = field(default_factory=set)
    offered: set[str] = field(default_factory=set)
    # Of ELF: versions of symbols such as "GLIBC_2.14". Of Mach-O: the oldest system.
    versions: set[str] = field(default_factory=set)
    signed: bool = False


def text(data, at):
    return data[at : data.index(b"\0", at)].decode()


def libraries(data):
    """All libraries in a file; only those of macOS hold more than one."""
    if data[:4] == b"\x7fELF":
        return [_elf(data)]
    if data[:2] == b"MZ":
        return [_pe(data)]
    if data[:4] == b"\xca\xfe\xba\xbe":
        (count,) = struct.unpack_from(">I", data, 4)
        result = []
        for k in range(count):
            processor, _, offset, size, alignment = struct.unpack_from(">5I", data, 8 + 20 * k)
            assert offset % (1 << alignment) == 0
            result.append(_mach(data[offset : offset + size]))
            assert result[-1].machine == {0x01000007: X86, 0x0100000C: ARM}[processor]
        return result
    return [_mach(data)]


def _elf(data):
    (machine,) = struct.unpack_from("<H", data, 18)
    sections, size, count = *struct.unpack_from("<Q", data, 40), *struct.unpack_from("<HH", data, 58)
    found = Library({62: X86, 183: ARM}[machine])
    headers = [struct.unpack_from("<IIQQQQIIQQ", data, sections + k * size) for k in range(count)]
    for _, kind, _, _, offset, length, link, info, _, entry in headers:
        names = headers[link][4] if link < count else 0
        if kind == 6:  # dynamic
            entries = struct.iter_unpack("<QQ", data[offset : offset + length])
            found.needed |= {text(data, names + value) for tag, value in entries if tag == 1}
        elif kind == 11:  # dynamic symbols
            for k in range(length // entry):
                name, _, _, section, _, _ = struct.unpack_from("<IBBHQQ", data, offset + k * entry)
                if section:
                    found.offered.add(text(data, names + name))
        elif kind == 0x6FFFFFFE:  # needed versions
            at = offset
            for _ in range(info):
                _, versions, _, first, following = struct.unpack_from("<HHIII", data, at)
                version = at + first
                for _ in range(versions):
                    _, _, _, name, step = struct.unpack_from("<IHHII", data, version)
                    found.versions.add(text(data, names + name))
                    version += step
                at += following
    return found


def _pe(data):
    (head,) = struct.unpack_from("<I", data, 0x3C)
    assert data[head : head + 4] == b"PE\0\0"
    machine, count, _, _, _, optional = struct.unpack_from("<HHIIIH", data, head + 4)
    found = Library({0x8664: X86, 0xAA64: ARM}[machine])
    start = head + 24
    assert struct.unpack_from("<H", data, start) == (0x20B,)
    table = [struct.unpack_from("<8sIIII", data, start + optional + 40 * k) for k in range(count)]

    def place(address):
        (result,) = (
            raw + address - low for _, size, low, stored, raw in table if low <= address < low + max(size, stored)
        )
        return result

    exports, _, imports, _ = struct.unpack_from("<4I", data, start + 112)
    at = place(imports)
    while (entry := struct.unpack_from("<5I", data, at))[3]:
        found.needed.add(text(data, place(entry[3])).lower())
        at += 20
    names, listed = (
        struct.unpack_from("<I", data, place(exports) + 24)[0],
        struct.unpack_from("<I", data, place(exports) + 32)[0],
    )
    found.offered = {
        text(data, place(a)) for (a,) in struct.iter_unpack("<I", data[place(listed) : place(listed) + 4 * names])
    }
    return found


def _mach(data):
    magic, processor, _, kind, count, _ = struct.unpack_from("<6I", data)
    assert (magic, kind) == (0xFEEDFACF, 6)
    found = Library({0x01000007: X86, 0x0100000C: ARM}[processor])
    at = 32
    for _ in range(count):
        command, size = struct.unpack_from("<II", data, at)
        if command in (0xC, 0x80000018):  # libraries that are loaded
            found.needed.add(text(data, at + struct.unpack_from("<I", data, at + 8)[0]))
        elif command == 0x2:  # symbols
            symbols, number, names, _ = struct.unpack_from("<4I", data, at + 8)
            for k in range(number):
                name, sort, _, _, _ = struct.unpack_from("<IBBHQ", data, symbols + 16 * k)
                if sort & 0x0E and sort & 0x01 and not sort & 0x10:  # defined, and seen from outside
                    found.offered.add(text(data, names + name).removeprefix("_"))
        elif command == 0x32:  # what it is built for
            _, oldest = struct.unpack_from("<II", data, at + 8)
            found.versions.add(f"{oldest >> 16}.{oldest >> 8 & 255}")
        elif command == 0x1D:  # signature
            found.signed = _signature_holds(data, *struct.unpack_from("<II", data, at + 8))
        at += size
    return found


def _signature_holds(data, offset, size):
    """Whether the hash of each page is the one that the signature names."""
    blob = data[offset : offset + size]
    (count,) = struct.unpack_from(">I", blob, 8)
    for kind, place in (struct.unpack_from(">II", blob, 12 + 8 * k) for k in range(count)):
        if kind:
            continue
        directory = blob[place:]
        hashes, _, _, slots, limit = struct.unpack_from(">5I", directory, 16)
        length, algorithm, _, page = struct.unpack_from(">4B", directory, 36)
        if algorithm != 2 or limit != offset:
            return False
        pages = [data[k << page : min((k + 1) << page, limit)] for k in range(slots)]
        return all(
            hashlib.sha256(part).digest()[:length] == directory[hashes + length * k : hashes + length * (k + 1)]
            for k, part in enumerate(pages)
        )
    return False
