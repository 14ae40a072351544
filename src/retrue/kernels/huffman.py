"""Whether the codes of a JPEG's scan lead from its beginning to its end, as many blocks on as there are."""

from __future__ import annotations

import cython


@cython.ccall
@cython.nogil
@cython.exceptval(check=False)
def bytes_left(
    content: cython.const[cython.uchar][::1],
    start: cython.Py_ssize_t,
    codes: cython.const[cython.ushort][:, ::1],
    short: cython.const[cython.ushort][:, ::1],
    of_block: cython.const[cython.int][:, ::1],
    count: cython.Py_ssize_t,
    restart: cython.Py_ssize_t,
) -> cython.Py_ssize_t:
    """Bytes between the last block of a sequential scan and the marker behind it; -1 where codes do not lead there.

    ITU T.81, annex F, without the numbers that the codes announce.

    codes (T, 65536): of the 16 bits that follow, 256 times the length of their code and its symbol; 0 where it is none.
    short (T, 512): the same of 9 bits, where they are enough; nearer at hand.
    of_block (B, 2): of each block of a unit, its tables for the mean and the rest; `count` units, a mark between each
    `restart` of them, or none (0).
    """
    cython.declare(
        bits=cython.ulonglong,
        ahead=cython.ulonglong,
        code=cython.int,
        byte=cython.uchar,
        unit=cython.Py_ssize_t,
        block=cython.Py_ssize_t,
        k=cython.int,
    )
    place: cython.Py_ssize_t = start
    last: cython.Py_ssize_t = content.shape[0] - 1
    held: cython.int = 0
    length: cython.int
    table: cython.int
    bits = 0
    for unit in range(count):
        if restart > 0 and unit > 0 and unit % restart == 0:
            if held >= 8 or place >= last or content[place] != 0xFF or content[place + 1] & 0xF8 != 0xD0:
                return -1
            bits, held, place = 0, 0, place + 2
        for block in range(of_block.shape[0]):
            k = 0
            while k < 64:
                if held < 32:  # a code and its number take no more
                    while held <= 48 and place < last:
                        byte = content[place]
                        if byte == 0xFF:
                            if content[place + 1] != 0:  # a marker
                                break
                            place += 1
                        bits = (bits << 8) | byte
                        place += 1
                        held += 8
                ahead = ((bits >> (held - 16)) if held >= 16 else (bits << (16 - held))) & 0xFFFF
                table = of_block[block, 1 if k > 0 else 0]
                code = cython.cast(cython.int, short[table, ahead >> 7])
                if code == 0:
                    code = cython.cast(cython.int, codes[table, ahead])
                length = (code >> 8) + (code & 15)
                if code == 0 or length > held:
                    return -1
                held -= length
                code &= 0xFF
                if k == 0:
                    k = 1
                elif code & 15 == 0 and code != 0xF0:  # the rest is zero
                    break
                else:
                    k += (code >> 4) + 1
            if k > 64:
                return -1
    start = place - held // 8
    while place < last and (content[place] != 0xFF or content[place + 1] == 0):
        place += 1
    return place - start if place < last else -1
