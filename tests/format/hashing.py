"""BLAKE3 in plain Python, for the checksums of packs: one hash of a whole message, without a key (O'Connor et al., "BLAKE3", 2020)."""
import struct

WORD = 2**32 - 1
IV = (0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A, 0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19)
ORDER = (2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8)
LANES = ((0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15), (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14))
SCHEDULE = [tuple(range(16))]
for _ in range(6):
    SCHEDULE.append(tuple(SCHEDULE[-1][i] for i in ORDER))


def compress(chain, words, counter, length, flags):
    v = list(chain) + list(IV[:4]) + [counter & WORD, counter >> 32, length, flags]
    for order in SCHEDULE:
        for lane, (i, j, k, l) in enumerate(LANES):
            a = (v[i] + v[j] + words[order[2 * lane]]) & WORD
            d = v[l] ^ a
            d = (d >> 16 | d << 16) & WORD
            c = (v[k] + d) & WORD
            b = v[j] ^ c
            b = (b >> 12 | b << 20) & WORD
            v[i] = a = (a + b + words[order[2 * lane + 1]]) & WORD
            d ^= a
            v[l] = d = (d >> 8 | d << 24) & WORD
            v[k] = c = (c + d) & WORD
            b ^= c
            v[j] = (b >> 7 | b << 25) & WORD
    return [v[i] ^ v[i + 8] for i in range(8)]


def blake3(data):
    """The 32 byte BLAKE3 hash of `data`."""

    def node(first, last, root):
        """The chaining value over the 1024 byte chunks `first` to `last - 1`."""
        if last - first == 1:
            piece, chain = data[1024 * first : 1024 * last], IV
            count = max(1, -(-len(piece) // 64))
            for b in range(count):
                block = piece[64 * b : 64 * b + 64]
                flags = (b == 0) | (2 | root if b == count - 1 else 0)
                chain = compress(chain, struct.unpack("<16I", block.ljust(64, b"\0")), first, len(block), flags)
            return chain
        middle = first + (1 << (last - first - 1).bit_length() - 1)
        return compress(IV, node(first, middle, 0) + node(middle, last, 0), 0, 64, 4 | root)

    return struct.pack("<8I", *node(0, max(1, -(-len(data) // 1024)), 8))
