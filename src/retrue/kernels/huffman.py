"""Where the codes of a JPEG's scan end, as many blocks on as there are."""

from __future__ import annotations

import cython

CHAINED = cython.declare(cython.int, 12)  # bits whose codes are looked up together


def codes_end(
    content: cython.const[cython.uchar][::1],
    start: cython.Py_ssize_t,
    words: cython.const[cython.ushort][:, ::1],
    of_block: cython.const[cython.int][::1],
    count: cython.Py_ssize_t,
    restart: cython.Py_ssize_t,
    codes: cython.ushort[:, ::1],
    chains: cython.ushort[:, ::1],
) -> cython.Py_ssize_t:
    """The place behind the last block of a sequential scan; -1 where codes do not lead there.

    ITU T.81, annex F, without the numbers that the codes announce.

    words (2 P, 256): of the codes of a table, one after another, 256 times length, and symbol; 0 behind the last.
    Of pair p, table 2 p is that of means, the next that of the rest.
    of_block (B,): of each block of a unit, its pair; `count` units, a mark between each `restart` of them, or none (0).
    codes (2 P, 65536), chains (2 P, 4096): scratch.
    """
    end: cython.Py_ssize_t
    table: cython.int
    with cython.nogil:
        for table in range(words.shape[0]):
            _spread(words, table, codes)
        for table in range(words.shape[0]):
            _chain(codes, table, chains)
        end = _followed(content, start, codes, of_block, count, restart, chains)
    return end


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _spread(words: cython.const[cython.ushort][:, ::1], table: cython.int, codes: cython.ushort[:, ::1]) -> cython.void:
    """`codes` <- of any 16 bits, the word that they begin with, or 0."""
    cython.declare(word=cython.int, bits=cython.int, k=cython.int, stop=cython.int)
    bits = 0
    for k in range(256):
        word = cython.cast(cython.int, words[table, k])
        stop = min(bits + (1 << (16 - (word >> 8))), 65536) if word > 0 else 65536
        while bits < stop:
            codes[table, bits] = word
            bits += 1


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _chain(codes: cython.const[cython.ushort][:, ::1], table: cython.int, chains: cython.ushort[:, ::1]) -> cython.void:
    """`chains` <- of any `CHAINED` bits, their whole codes of one block: 2048 where these end it, 32 times the numbers
    that they stand for, and all their bits; those of a table of means go on with the rest."""
    cython.declare(code=cython.int, used=cython.int, stood=cython.int, ends=cython.int, bits=cython.int)
    cython.declare(means=cython.bint)
    for bits in range(1 << CHAINED):
        used, stood, ends, means = 0, 0, 0, table % 2 == 0
        while used < CHAINED and ends == 0:
            code = cython.cast(
                cython.int,
                codes[table if means else table | 1, (bits << (16 - CHAINED + used)) & 0xFFFF],
            )
            if code == 0 or used + (code >> 8) > CHAINED:
                break
            used += (code >> 8) + (code & 15)
            if means:
                stood, means = 1, False
            elif code & 15 == 0 and code & 0xF0 != 0xF0:  # the rest is zero
                ends = 1
            else:
                stood += ((code >> 4) & 15) + 1
        chains[table, bits] = (ends << 11) | (min(stood, 63) << 5) | used


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _followed(
    content: cython.const[cython.uchar][::1],
    start: cython.Py_ssize_t,
    codes: cython.const[cython.ushort][:, ::1],
    of_block: cython.const[cython.int][::1],
    count: cython.Py_ssize_t,
    restart: cython.Py_ssize_t,
    chains: cython.const[cython.ushort][:, ::1],
) -> cython.Py_ssize_t:
    cython.declare(bits=cython.ulonglong, ahead=cython.ulonglong, word=cython.uint, byte=cython.uchar)
    cython.declare(unit=cython.Py_ssize_t, block=cython.Py_ssize_t, k=cython.int, code=cython.int, chain=cython.int)
    place: cython.Py_ssize_t = start
    last: cython.Py_ssize_t = content.shape[0] - 1
    held: cython.int = 0
    length: cython.int
    table: cython.int
    reached: cython.int
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
                    if place + 3 < last:
                        word = (
                            (cython.cast(cython.uint, content[place]) << 24)
                            | (cython.cast(cython.uint, content[place + 1]) << 16)
                            | (cython.cast(cython.uint, content[place + 2]) << 8)
                            | content[place + 3]
                        )
                        if (((word & 0x7F7F7F7F) + 0x01010101) & word) >> 7 & 0x01010101 == 0:  # no byte is 0xFF
                            bits = (bits << 32) | word
                            place += 4
                            held += 32
                    while held < 32 and place < last:
                        byte = content[place]
                        if byte == 0xFF:
                            if content[place + 1] != 0:  # a marker
                                break
                            place += 1
                        bits = (bits << 8) | byte
                        place += 1
                        held += 8
                ahead = ((bits >> (held - 16)) if held >= 16 else (bits << (16 - held))) & 0xFFFF
                table = 2 * of_block[block] + (k > 0)
                chain = cython.cast(cython.int, chains[table, ahead >> (16 - CHAINED)])
                reached = k + ((chain >> 5) & 63)
                length = chain & 31
                if chain > 0 and reached < 64 and length <= held:
                    held -= length
                    if chain >= 2048:
                        break
                    k = reached
                    continue
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
    return place - held // 8
