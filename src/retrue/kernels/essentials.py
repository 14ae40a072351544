"""Essential matrices of five matches each.

E = x X + y Y + z Z + W in the null space of the five equations; det E = 0 and 2 E E^T E = tr(E E^T) E are ten cubic
equations in x, y, z. Eliminated, they leave three that are linear in x and y, whose determinant is of degree ten in z
(Nister 2004). The real roots of a polynomial lie between those of its derivative.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

DEGREE = cython.declare(cython.Py_ssize_t, 10)
STEPS = cython.declare(cython.Py_ssize_t, 60)
SETTLED = cython.declare(cython.double, 1e-6)
BOUND = cython.declare(cython.double, 1.1)  # roots beyond are those of the reversed polynomial
POLISHED = cython.declare(cython.Py_ssize_t, 12)
EXACT = cython.declare(cython.double, 1e-7)
TOUCHES = cython.declare(cython.double, 1e-9)
SINGULAR = cython.declare(cython.double, 1e-13)  # of the largest pivot


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _reduce(A: cython.p_double, rows: cython.Py_ssize_t, columns: cython.Py_ssize_t) -> cython.bint:
    """Gauss-Jordan elimination of the first `rows` columns, pivots by rows; False of a singular system."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    largest = 0.0
    for k in range(rows):
        pivot: cython.Py_ssize_t = k
        for i in range(k + 1, rows):
            if fabs(A[i * columns + k]) > fabs(A[pivot * columns + k]):
                pivot = i
        value = A[pivot * columns + k]
        largest = max(largest, fabs(value))
        if not fabs(value) > SINGULAR * largest:
            return False
        for j in range(k, columns):
            A[pivot * columns + j], A[k * columns + j] = A[k * columns + j], A[pivot * columns + j] / value
        for i in range(rows):
            if i != k:
                factor = A[i * columns + k]
                if factor != 0:
                    for j in range(k, columns):
                        A[i * columns + j] -= factor * A[k * columns + j]
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _null_space(design: cython.p_double, basis: cython.p_double) -> cython.bint:
    """`basis` (9, 4) <- what all five rows (5, 9) are zero of; False where they leave more than that."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    order = cython.declare(cython.Py_ssize_t[9])
    for j in range(9):
        order[j] = j
    largest = 0.0
    for k in range(5):
        row: cython.Py_ssize_t = k
        column: cython.Py_ssize_t = k
        for i in range(k, 5):
            for j in range(k, 9):
                if fabs(design[9 * i + j]) > fabs(design[9 * row + column]):
                    row, column = i, j
        for i in range(5):
            design[9 * i + k], design[9 * i + column] = design[9 * i + column], design[9 * i + k]
        order[k], order[column] = order[column], order[k]
        value = design[9 * row + k]
        largest = max(largest, fabs(value))
        if not fabs(value) > SINGULAR * largest:
            return False
        for j in range(9):
            design[9 * row + j], design[9 * k + j] = design[9 * k + j], design[9 * row + j] / value
        for i in range(5):
            if i != k:
                factor = design[9 * i + k]
                for j in range(k, 9):
                    design[9 * i + j] -= factor * design[9 * k + j]
    for k in range(4):
        length = 1.0
        for i in range(5):
            length += design[9 * i + 5 + k] * design[9 * i + 5 + k]
        for i in range(9):
            value = -design[9 * i + 5 + k] if i < 5 else 1.0 if i == 5 + k else 0.0
            basis[4 * order[i] + k] = value / sqrt(length)
    for i in range(9):  # turned by a quaternion that is nothing special: of points on a plane, solutions share entries
        a, b, c, d = basis[4 * i], basis[4 * i + 1], basis[4 * i + 2], basis[4 * i + 3]
        basis[4 * i], basis[4 * i + 1] = 0.4 * a - 0.2 * b - 0.8 * c - 0.4 * d, 0.4 * b + 0.2 * a + 0.8 * d - 0.4 * c
        basis[4 * i + 2] = 0.4 * c - 0.2 * d + 0.8 * a + 0.4 * b
        basis[4 * i + 3] = 0.4 * d + 0.2 * c - 0.8 * b + 0.4 * a
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _add_product(
    a: cython.p_double,
    from_a: cython.Py_ssize_t,
    b: cython.p_double,
    from_b: cython.Py_ssize_t,
    which: cython.const[cython.longlong][:, ::1],
    factor: cython.double,
    c: cython.p_double,
    from_c: cython.Py_ssize_t,
) -> cython.void:
    """c += factor a b of a polynomial in (x, y, z) and a linear one: `which` monomial each pair of theirs makes."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    for i in range(which.shape[0]):
        for j in range(4):
            c[from_c + which[i, j]] += factor * a[from_a + i] * b[from_b + j]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _cubics(
    E: cython.p_double,
    two: cython.const[cython.longlong][:, ::1],
    three: cython.const[cython.longlong][:, ::1],
    system: cython.p_double,
) -> cython.void:
    """`system` (10, 20) <- the ten equations on the entries E (9, 4), linear in (x, y, z, 1)."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, m=cython.Py_ssize_t)
    squares, minor = cython.declare(cython.double[90]), cython.declare(cython.double[10])
    for k in range(90):
        squares[k] = 0.0
    for k in range(200):
        system[k] = 0.0
    for i in range(3):
        for j in range(i, 3):
            for k in range(3):
                _add_product(E, 12 * i + 4 * k, E, 12 * j + 4 * k, two, 2.0, squares, 30 * i + 10 * j)
    for m in range(10):  # 2 E E^T - tr(E E^T)
        trace = (squares[m] + squares[40 + m] + squares[80 + m]) / 2
        squares[m], squares[40 + m], squares[80 + m] = (
            squares[m] - trace,
            squares[40 + m] - trace,
            squares[80 + m] - trace,
        )
        squares[30 + m], squares[60 + m], squares[70 + m] = squares[10 + m], squares[20 + m], squares[50 + m]
    for i in range(3):
        for k in range(3):
            for j in range(3):
                _add_product(squares, 30 * i + 10 * j, E, 12 * j + 4 * k, three, 1.0, system, 60 * i + 20 * k)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for m in range(10):
            minor[m] = 0.0
        _add_product(E, 12 + 4 * i, E, 24 + 4 * j, two, 1.0, minor, 0)
        _add_product(E, 12 + 4 * j, E, 24 + 4 * i, two, -1.0, minor, 0)
        _add_product(minor, 0, E, 4 * k, three, 1.0, system, 180)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _value(p: cython.p_double, first: cython.Py_ssize_t, degree: cython.Py_ssize_t, z: cython.double) -> cython.double:
    """Of a polynomial whose coefficients begin there, by Horner's rule."""
    cython.declare(j=cython.Py_ssize_t)
    value = p[first + degree]
    for j in range(degree):
        value = value * z + p[first + degree - 1 - j]
    return value


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _root(
    p: cython.p_double,
    order: cython.Py_ssize_t,
    low: cython.double,
    high: cython.double,
    rises: cython.bint,
) -> cython.double:
    """The root of a derivative where its sign changes: Newton's method, halving where that leads outside."""
    degree: cython.Py_ssize_t = DEGREE - order
    z = (low + high) / 2
    for _ in range(STEPS):
        value, slope = _value(p, 11 * order, degree, z), _value(p, 11 * order + 11, degree - 1, z)
        if (value > 0) == rises:
            high = z
        else:
            low = z
        ahead = z - value / slope if slope != 0 else low
        if not (low < ahead and ahead < high):
            ahead = (low + high) / 2
        if fabs(ahead - z) <= SETTLED:
            break
        z = ahead
    return z


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _roots(p: cython.p_double, bound: cython.double, roots: cython.p_double) -> cython.Py_ssize_t:
    """`roots` <- those up to the bound, and places that nearly are some; `p` (11, 11) begins with the coefficients."""
    cython.declare(j=cython.Py_ssize_t, k=cython.Py_ssize_t, order=cython.Py_ssize_t)
    for k in range(DEGREE):
        for j in range(DEGREE - k):
            p[11 * (k + 1) + j] = p[11 * k + j + 1] * (j + 1)
    size = 0.0
    for j in range(DEGREE + 1):
        size += fabs(p[j])
    count: cython.Py_ssize_t = 0
    for k in range(DEGREE):
        order = DEGREE - 1 - k
        degree: cython.Py_ssize_t = k + 1
        number: cython.Py_ssize_t = count
        count = 0
        low = -bound
        before = _value(p, 11 * order, degree, low)
        for j in range(number + 1):
            high = roots[j] if j < number else bound
            after = _value(p, 11 * order, degree, high)
            if (before > 0) != (after > 0):  # `count` is not ahead of `j`: what is overwritten has been read
                roots[count] = _root(p, order, low, high, after > 0)
                count += 1
            elif order == 0 and j < number and fabs(after) < TOUCHES * size:
                roots[count] = high
                count += 1
            low, before = high, after
    return count


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _polish(E: cython.p_double, w: cython.p_double) -> cython.void:
    """Gauss-Newton steps of w = (x, y, z) on 2 E E^T E = tr(E E^T) E: rounding is far larger in the polynomial."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, m=cython.Py_ssize_t)
    e, square = cython.declare(cython.double[9]), cython.declare(cython.double[9])
    along, turned = cython.declare(cython.double[9]), cython.declare(cython.double[9])
    rows, normal = cython.declare(cython.double[36]), cython.declare(cython.double[12])
    for _ in range(POLISHED):
        for j in range(9):
            e[j] = E[4 * j] * w[0] + E[4 * j + 1] * w[1] + E[4 * j + 2] * w[2] + E[4 * j + 3]
        for i in range(3):
            for k in range(3):
                square[3 * i + k] = e[3 * i] * e[3 * k] + e[3 * i + 1] * e[3 * k + 1] + e[3 * i + 2] * e[3 * k + 2]
        trace = square[0] + square[4] + square[8]
        for m in range(4):  # derivatives along x, y, z, and along E itself: thrice the value
            for j in range(9):
                along[j] = E[4 * j + m] if m < 3 else e[j]
            for i in range(3):
                for k in range(3):
                    turned[3 * i + k] = 0.0
                    for j in range(3):
                        turned[3 * i + k] += along[3 * i + j] * e[3 * k + j] + e[3 * i + j] * along[3 * k + j]
            slope = turned[0] + turned[4] + turned[8]
            for i in range(3):
                for k in range(3):
                    value = -slope * e[3 * i + k] - trace * along[3 * i + k]
                    for j in range(3):
                        value += 2 * (turned[3 * i + j] * e[3 * j + k] + square[3 * i + j] * along[3 * j + k])
                    rows[12 * i + 4 * k + m] = value
        for i in range(3):
            for k in range(4):
                normal[4 * i + k] = 0.0
                for j in range(9):
                    normal[4 * i + k] += rows[4 * j + i] * rows[4 * j + k]
        if not _reduce(normal, 3, 4):
            break
        w[0], w[1], w[2] = w[0] - normal[3] / 3, w[1] - normal[7] / 3, w[2] - normal[11] / 3
        if fabs(normal[3]) + fabs(normal[7]) + fabs(normal[11]) < EXACT:
            break


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _add_essentials(
    design: cython.p_double,
    two: cython.const[cython.longlong][:, ::1],
    three: cython.const[cython.longlong][:, ::1],
    found: cython.double[:, :, ::1],
    count: cython.Py_ssize_t,
) -> cython.Py_ssize_t:
    """Add the essential matrices of five equations (5, 9), of norm 1, to the `count` in `found`; and count on."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    E, system = cython.declare(cython.double[36]), cython.declare(cython.double[200])
    B, minor = cython.declare(cython.double[45]), cython.declare(cython.double[7])
    p, derivatives = cython.declare(cython.double[11]), cython.declare(cython.double[121])
    roots, rows = cython.declare(cython.double[11]), cython.declare(cython.double[9])
    cofactor, w = cython.declare(cython.double[3]), cython.declare(cython.double[3])
    if not _null_space(design, E):
        return count
    _cubics(E, two, three, system)
    if not _reduce(system, 10, 20):
        return count
    for i in range(3):  # each row: coefficients in z of x (4), of y (4) and of 1 (5)
        for k in range(3):
            last: cython.Py_ssize_t = 12 + 3 * k + (k == 2)
            above: cython.Py_ssize_t = 20 * (4 + 2 * i) + last
            below: cython.Py_ssize_t = above + 20
            degree: cython.Py_ssize_t = 3 + (k == 2)
            first: cython.Py_ssize_t = 15 * i + 5 * k
            B[first], B[first + degree] = system[above], -system[below - degree + 1]
            for j in range(1, degree):
                B[first + j] = system[above - j] - system[below - j + 1]
    for j in range(DEGREE + 1):
        p[j] = 0.0
    for k in range(3):
        i, j = 15 * ((k + 1) % 3), 15 * ((k + 2) % 3)
        for last in range(7):
            minor[last] = 0.0
        for last in range(4):
            for degree in range(4):
                minor[last + degree] += B[i + last] * B[j + 5 + degree] - B[j + last] * B[i + 5 + degree]
        for last in range(7):
            for degree in range(5):
                p[last + degree] += minor[last] * B[15 * k + 10 + degree]
    for far in range(2):  # small roots, and the inverses of large ones
        for j in range(DEGREE + 1):
            derivatives[j] = p[DEGREE - j] if far else p[j]
        number: cython.Py_ssize_t = _roots(derivatives, 1 / BOUND if far else BOUND, roots)
        for k in range(number):
            z = roots[k]
            if far:
                if z == 0:
                    continue
                z = 1 / z
            for i in range(3):
                rows[3 * i], rows[3 * i + 1] = _value(B, 15 * i, 3, z), _value(B, 15 * i + 5, 3, z)
                rows[3 * i + 2] = _value(B, 15 * i + 10, 4, z)
            cofactor[2] = 0.0
            for i in range(3):
                j = (i + 1) % 3
                third = rows[3 * i] * rows[3 * j + 1] - rows[3 * i + 1] * rows[3 * j]
                if fabs(third) > fabs(cofactor[2]):
                    cofactor[0] = rows[3 * i + 1] * rows[3 * j + 2] - rows[3 * i + 2] * rows[3 * j + 1]
                    cofactor[1] = rows[3 * i + 2] * rows[3 * j] - rows[3 * i] * rows[3 * j + 2]
                    cofactor[2] = third
            if cofactor[2] == 0:
                continue
            w[0], w[1], w[2] = cofactor[0] / cofactor[2], cofactor[1] / cofactor[2], z
            _polish(E, w)
            square = 0.0
            for j in range(9):
                value = E[4 * j] * w[0] + E[4 * j + 1] * w[1] + E[4 * j + 2] * w[2] + E[4 * j + 3]
                found[count, j // 3, j % 3] = value
                square += found[count, j // 3, j % 3] * found[count, j // 3, j % 3]
            scale = 1 / sqrt(square)
            for j in range(9):
                found[count, j // 3, j % 3] *= scale
            count += 1
    return count


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _equations(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    rows: cython.const[cython.longlong][::1],
    design: cython.p_double,
) -> cython.void:
    """`design` (5, 9) <- those of y^T E x = 0."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    for i in range(5):
        k = rows[i]
        for j in range(3):
            factor = y[k, j] if j < 2 else 1.0
            design[9 * i + 3 * j], design[9 * i + 3 * j + 1] = factor * x[k, 0], factor * x[k, 1]
            design[9 * i + 3 * j + 2] = factor


def essentials(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    samples: cython.const[cython.longlong][:, ::1],
    two: cython.const[cython.longlong][:, ::1],
    three: cython.const[cython.longlong][:, ::1],
    found: cython.double[:, :, ::1],
) -> int:
    """`found` (20 S, 3, 3) <- all essential matrices that samples (S, 5) of matches (N, 2) allow, and their number.

    `two` (4, 4) and `three` (10, 4) number the monomials that two linear factors make, and a quadratic and a linear.
    """
    cython.declare(s=cython.Py_ssize_t)
    design = cython.declare(cython.double[45])
    count: cython.Py_ssize_t = 0
    with cython.nogil:
        for s in range(samples.shape[0]):
            _equations(x, y, samples[s], design)
            count = _add_essentials(design, two, three, found, count)
    return count
