"""Zero-order-hold equivalent of a plant with dead time, in ball arithmetic, with its derivatives.

    P(z) = sum_j z^-j c adj(zI - Phi) g_j / det(zI - Phi),    j = m, ..., m + K .                                   (1)

The control of j samples ago acts with the weight

    g_j = W(1 - clip(l - j)) - W(1 - clip(l - j + 1)),    W(t) = int_0^t e^{As} b ds ,                              (2)

l is the delay and t the time, both in samples; clip limits to [0, 1].  The formula also holds for a delay that is
uncertain across several samples.  At the kinks of clip its derivative is enclosed by [0, 1].  Both polynomials are
given in w = (z - 1)/(z + 1), without the factor z^-(m + 1).

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997; (2) is derived for any delay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

from flint import arb, arb_mat

from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.dual_matrix import DualMatrix
from fopi_tune.proof.balls.plant import Dual, PlantEnclosure

_ONE, _ZERO = arb(1), arb(0)
#: arguments below this use a series instead of a difference of reciprocals
_SMALL = arb(1e-4)
#: most samples across which a delay may be uncertain; a wider box must be split
_MOST_SPAN = 12


def hold_equivalent(
    plant: PlantEnclosure, sample_time: arb, samples: Dual, axes: int, span: tuple[int, int] | None = None
) -> PlantEnclosure:
    """Numerator and denominator of (1) in w, over a box.

    Args:
        plant: in s.
        sample_time: Ts, s.
        samples: l, the dead time and the computing delay.
        axes: of the box, frequency included.
        span: whole samples at and just below the ends of l, or of a wider range, as `samples_spanned` gives them.

    Returns:
        The same plants in w; not a number where a direct path's delay is uncertain across a whole number of samples,
        or any delay across too many.
    """
    first, last = span if span is not None else samples_spanned(samples)
    times = [1 - _clip(samples - j) for j in range(first, last + 1)]
    leading = plant.denominator[0]
    degree = len(plant.denominator) - 1
    direct = plant.numerator[0] / leading if plant.has_direct_path else None
    if len(times) > _MOST_SPAN or (direct is not None and len(times) > 1):
        # split the dead time first; with a direct path the response is not continuous in it
        return PlantEnclosure((Dual(arb.nan()),), (Dual.of(1),), Dual.of(0), first + 1)
    if degree == 1 and direct is None and not plant.denominator[1].value.contains(0):
        return _first_order(plant, sample_time, times, first)
    weights, characteristic = _any_order(plant, direct, sample_time, times, axes)
    return _bilinear(weights, characteristic, direct, first)


def samples_spanned(samples: Dual) -> tuple[int, int]:
    """Whole samples at the ends of an uncertain delay, each rounded down."""
    return _floor(samples.value.lower()), _floor(samples.value.upper())


def sharpened(over: PlantEnclosure, centre: PlantEnclosure, shifts: Sequence[arb]) -> PlantEnclosure:
    """The same plants, each coefficient x also enclosed by the mean-value form  x(c) + sum_k x_k(X) (X_k - c_k).

    In the products of e^A - I intervals forget that they depend on the same numbers, so that the plain enclosure of a
    coefficient is wider than its range by a factor that no split reduces; that of the mean-value form tends to 1.

    Args:
        over: over a box, with the derivatives x_k.
        centre: at its centre, with the same delay in samples.
        shifts: X_k - c_k.
    """

    def sharp(wide: Dual, at: Dual) -> Dual:
        moved = sum((slope * shifts[axis - 1] for axis, slope in wide.gradient.items()), at.value)
        return Dual(wide.value.intersection(moved), wide.gradient) if moved.is_finite() else wide

    def all_sharp(wide: tuple[Dual, ...], at: tuple[Dual, ...]) -> tuple[Dual, ...]:
        return tuple(sharp(x, y) for x, y in zip(wide, at, strict=True))

    numerator, denominator = (
        all_sharp(over.numerator, centre.numerator),
        all_sharp(over.denominator, centre.denominator),
    )
    return replace(over, numerator=numerator, denominator=denominator)


def _clip(x: Dual) -> Dual:
    """x limited to [0, 1]."""
    low, high = x.value.lower(), x.value.upper()
    if low >= 0 and high <= 1:
        return x
    if high <= 0:
        return Dual(_ZERO)
    if low >= 1:
        return Dual(_ONE)
    ends = [arb(0) if end < 0 else arb(1) if end > 1 else arb(end) for end in (low, high)]
    between = arb(0).union(arb(1))
    return Dual(ends[0].union(ends[1]), {axis: slope * between for axis, slope in x.gradient.items()})


def _first_order(plant: PlantEnclosure, ts: arb, times: list[Dual], first: int) -> PlantEnclosure:
    """(1) for n1/(d0 s + d1), x = Ts d1/d0, each uncertain number as rarely as possible:

    P = (n1/d1) z^-(m+1) z^(1-K) (1 - w) (1 + sum_j phi_j z^(k_j - 1) (z - 1))/(1 + w coth(x/2)),
    phi_j = (1 - e^{-x t_j})/(1 - e^{-x}),   k_j = K - j,   j = 0 ... K - 1 .

    Where d0 is known, with (n1 Ts/(2 d0)) q/(w + tanh(x/2)), q = tanh(x/2)/(x/2), in place of
    (n1/d1)/(1 + w coth(x/2)): towards z = -1 a slow pole then hardly matters, which the quotient of two numbers that
    depend on it would not show.
    """
    rate = plant.denominator[0] / plant.denominator[1]
    x = ts / rate
    half = x.value / 2
    if plant.denominator[0].gradient:
        lag = Dual(half.coth(), {axis: -slope / (2 * half.sinh() ** 2) for axis, slope in x.gradient.items()})
        bottom = [lag, Dual.of(1)]
        gain = plant.numerator[-1] / plant.denominator[1]
    else:
        pole = Dual(half.tanh(), {axis: slope / (2 * half.cosh() ** 2) for axis, slope in x.gradient.items()})
        quotient = _monotone_range(x.value, lambda y: (y / 2).tanh() / (y / 2))
        slopes = {axis: quotient * _tanh_slope(x.value) * slope for axis, slope in x.gradient.items()}
        bottom = [Dual.of(1), pole]
        gain = plant.numerator[-1] / plant.denominator[0] * (ts / 2) * Dual(quotient, slopes)
    span = len(times)
    top = [Dual.of(c) for c in _monomial(0, 0, span)]
    for j, t in enumerate(times):
        _add(top, _step_ratio(x, t), _monomial(span - 1 - j, 1, span))
    return PlantEnclosure(tuple(top), tuple(_times_one_plus_w(span, bottom)), Dual.of(0), first + 1, gain)


def _tanh_slope(x: arb) -> arb:
    """d ln(tanh(x/2)/(x/2))/dx = 1/sinh x - 1/x = 2x sum_n (-1)^n/(x^2 + (n pi)^2), whose derivative is within 1/3."""
    middle = arb(x.mid())
    # by the same series |1/sinh x - 1/x + x/6| <= |x|^3/45
    at = -middle / 6 + arb(0, 1) * abs(middle) ** 3 / 45 if abs(middle) < _SMALL else 1 / middle.sinh() - 1 / middle
    ends = _monotone_range(x, lambda y: 1 / y.sinh()) - _monotone_range(x, lambda y: 1 / y)
    near = at + (x - middle) * arb(0, 1) / 3
    return near.intersection(ends) if ends.is_finite() else near


def _step_ratio(x: Dual, t: Dual) -> Dual:
    """phi = (1 - e^{-xt})/(1 - e^{-x}), 0 <= t <= 1, x != 0:  increasing in x and t, so the ends enclose it.

    d phi/dt = e^{-xt}/g(x),  d phi/dx = phi (t h(xt) - h(x)),  g(y) = (1 - e^{-y})/y decreases, h = g'/g increases.
    """
    if t.value == 1 and not t.gradient:
        return Dual.of(1)
    low, high = _ends(x.value), _ends(t.value)
    values = [(-a * b).expm1() / (-a).expm1() for a, b in zip(low, high, strict=True)]
    phi = values[0].union(values[1])
    g = _monotone_range(x.value, lambda y: -(-y).expm1() / y)
    along_t = (-x.value * t.value).exp() / g
    along_x = phi * (t.value * _monotone_range(x.value * t.value, _log_slope) - _monotone_range(x.value, _log_slope))
    gradient = {axis: along_x * slope for axis, slope in x.gradient.items()}
    for axis, slope in t.gradient.items():
        gradient[axis] = gradient.get(axis, _ZERO) + along_t * slope
    return Dual(phi, gradient)


def _ends(ball: arb) -> tuple[arb, arb]:
    return arb(ball.lower()), arb(ball.upper())


def _monotone_range(ball: arb, monotone: Callable[[arb], arb]) -> arb:
    """The range of a monotone function over a ball."""
    low, high = _ends(ball)
    return monotone(low) if low == high else monotone(low).union(monotone(high))


def _log_slope(y: arb) -> arb:
    """h(y) = 1/(e^y - 1) - 1/y; -1/2 at 0."""
    if abs(y) < _SMALL:
        # |h(y) + 1/2 - y/12| <= |y|^3/720
        return arb(-0.5) + y / 12 + arb(0, 1) * abs(y) ** 3
    return 1 / y.expm1() - 1 / y


#: per time t_j the coefficients of c adj(delta - E) W(t_j), and those of det(delta - E), descending powers of delta
_Weights = tuple[list[list[Dual]], list[Dual]]


def _any_order(plant: PlantEnclosure, direct: Dual | None, ts: arb, times: list[Dual], axes: int) -> _Weights:
    """By the exponential of the companion form, the derivatives by that of [[A, dA], [0, A]].

    The last weight, of t = 1, is that of all earlier controls together.
    """
    leading = plant.denominator[0]
    n = len(plant.denominator) - 1
    if n == 0:
        return [[] for _ in range(len(times) + 1)], [Dual.of(1)]
    # time in samples, s Ts: coefficients of descending powers are multiplied by Ts^0, Ts^1, ...
    missing = n + 1 - len(plant.numerator)
    scaled = [c / leading * ts**k for k, c in enumerate(plant.denominator)]
    c = [Dual.of(0)] * (missing - 1) + [
        b / leading * ts ** (n + 1 - len(plant.numerator) + k) for k, b in enumerate(plant.numerator)
    ]
    c = c[-n:]
    a = [-value for value in scaled[1:]]
    if direct is not None:
        c = [value + direct * coefficient for value, coefficient in zip(c, a, strict=True)]
    phi, whole = _hold(a, Dual.of(1), axes)
    columns = [whole if t.value == 1 and not t.gradient else _hold(a, t, axes)[1] for t in times] + [whole]
    weights, characteristic = _adjugate(phi - DualMatrix.identity(n), DualMatrix.of([c]), columns)
    for k in range(1, n + 1):
        # an integrator's pole is at z = 1 exactly
        if all(value.value.is_zero() and not value.gradient for value in plant.denominator[k:]):
            characteristic[k] = Dual.of(0)
    return weights, characteristic


def _adjugate(e: DualMatrix, row: DualMatrix, columns: list[DualMatrix]) -> _Weights:
    """row adj(delta - E) column of each column, and det(delta - E), by Faddeev's and LeVerrier's recursion:

    B_0 = 1,  c_k = -tr(E B_(k-1))/k,  B_k = E B_(k-1) + c_k .
    """
    n = e.size
    identity = b = DualMatrix.identity(n)
    characteristic, weights = [Dual.of(1)], [[] for _ in columns]
    for k in range(1, n + 1):
        left = row @ b
        for weight, column in zip(weights, columns, strict=True):
            weight.append((left @ column).entry(0, 0))
        eb = e @ b
        characteristic.append(eb.trace() * (arb(-1) / k))
        b = eb + identity * characteristic[-1]
    return weights, characteristic


def _hold(a: list[Dual], t: Dual, axes: int) -> tuple[DualMatrix, DualMatrix]:
    """e^{At} and W(t) = int_0^t e^{As} b ds of a companion form with its top row a, with their gradients."""
    n = len(a)
    whole = (arb_mat(_block([x.value for x in a])) * t.value).exp()
    phi, column = DualMatrix(_part(whole, 0, n, n), {}), DualMatrix(_part(whole, n, n, 1), {})
    for axis in range(1, axes):
        slopes = [x.gradient.get(axis) for x in a]
        if any(slope is not None for slope in slopes):
            moved = _exponential_derivative(a, [s if s is not None else _ZERO for s in slopes], t.value)
            phi.gradient[axis], column.gradient[axis] = _part(moved, n + 1, n, n), _part(moved, 2 * n + 1, n, 1)
        if axis in t.gradient:
            # dW/dt = e^{At} b; Phi itself is asked for at t = 1 alone
            along_t = _part(whole, 0, n, 1) * t.gradient[axis]
            column.gradient[axis] = column.gradient[axis] + along_t if axis in column.gradient else along_t
    return phi, column


def _part(matrix: arb_mat, first: int, rows: int, columns: int) -> arb_mat:
    """The first rows of the columns from `first` on."""
    return arb_mat([[matrix[i, first + j] for j in range(columns)] for i in range(rows)])


def _block(a: list[arb]) -> list[list[arb]]:
    """[[A, b], [0, 0]], whose exponential holds e^A and int_0^1 e^{As} b ds."""
    n = len(a)
    rows = [[_ZERO] * (n + 1) for _ in range(n + 1)]
    rows[0][:n] = a
    rows[0][n] = _ONE
    for i in range(1, n):
        rows[i][i - 1] = _ONE
    return rows


def _exponential_derivative(a: list[Dual], slopes: list[arb], t: arb) -> arb_mat:
    """exp of [[M, dM], [0, M]]: its upper right block is the derivative of exp M."""
    block = _block([x.value for x in a])
    zeros = [_ZERO] * len(block)
    top = [[*row, *zeros] for row in block]
    top[0][len(block) : len(block) + len(slopes)] = slopes
    return (arb_mat([*top, *([*zeros, *row] for row in block)]) * t).exp()


def _bilinear(weights: list[list[Dual]], characteristic: list[Dual], direct: Dual | None, first: int) -> PlantEnclosure:
    """(1) with delta = 2w/(1 - w), both polynomials times (1 - w)^degree.

    sum_j g_j z^(K - j) with g_j = W_j - W_(j-1) is W_K + sum_(j<K) W_j z^(K - j - 1) (z - 1).  The numerator has degree
    n - 1 + K in z: the factor (1 - w)^(1 - K) that is left over is one part of z^-(K-1), whose other part,
    (1 + w)^-(K-1), goes to the denominator.
    """
    n, span = len(characteristic) - 1, len(weights) - 1
    top = [Dual.of(0)] * (n + span)
    for j, weight in enumerate(weights):
        for i, coefficient in enumerate(weight):
            power = n - 1 - i
            if j < span:
                _add(top, coefficient, _monomial(span - j - 1, power + 1, span + n - 1))
            else:
                _add(top, coefficient, _monomial(0, power, span + n - 1))
    bottom = [Dual.of(0)] * (n + 1)
    for i, coefficient in enumerate(characteristic):
        _add(bottom, coefficient, _monomial(0, n - i, n))
    if direct is not None:
        # z^-late direct R: the only power of z
        top = [x + direct * y for x, y in zip(top, bottom, strict=True)]
    return PlantEnclosure(tuple(top), tuple(_times_one_plus_w(span, bottom)), Dual.of(0), first + 1)


def _times_one_plus_w(span: int, bottom: list[Dual]) -> list[Dual]:
    """The denominator times (1 + w)^(K - 1)."""
    for _ in range(span - 1):
        bottom = [x + y for x, y in zip([*bottom, Dual.of(0)], [Dual.of(0), *bottom], strict=True)]
    return bottom


@cache
def _monomial(later: int, power: int, degree: int) -> tuple[int, ...]:
    """(1 + w)^later (2w)^power (1 - w)^(degree - later - power), descending powers."""
    rising, falling = [1], [1]
    for _ in range(later):
        rising = [a + b for a, b in zip([*rising, 0], [0, *rising], strict=True)]
    for _ in range(degree - later - power):
        # times (1 - w) = -w + 1
        falling = [b - a for a, b in zip([*falling, 0], [0, *falling], strict=True)]
    product = [0] * (len(rising) + len(falling) - 1)
    for i, x in enumerate(rising):
        for j, y in enumerate(falling):
            product[i + j] += x * y
    return (*(value * 2**power for value in product), *(0,) * power)


def _add(total: list[Dual], coefficient: Dual, polynomial: Sequence[int]) -> None:
    """total += coefficient * polynomial."""
    for i, value in enumerate(polynomial):
        if value:
            total[i] = total[i] + coefficient * value


def _floor(number: arb) -> int:
    whole = number.floor().unique_fmpz()
    if whole is None:
        raise DomainError("the delay cannot be counted in samples; its bounds are too wide")
    return int(whole)
