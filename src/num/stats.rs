//! Statistics in f64: compensated sums, moments, exact quantiles, and a distribution of bounded
//! memory for streams that are too long to keep.

/// A compensated sum (Neumaier's form of Kahan's): the error of adding n numbers stays at a few
/// units in the last place of Σ|x|, whatever n.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sum {
    total: f64,
    compensation: f64,
}

impl Sum {
    /// Adds one number.
    pub fn add(&mut self, x: f64) {
        let total = self.total + x;
        self.compensation += if self.total.abs() >= x.abs() {
            (self.total - total) + x
        } else {
            (x - total) + self.total
        };
        self.total = total;
    }

    /// The sum of everything added so far; 0 for nothing.
    #[must_use]
    pub fn value(self) -> f64 {
        self.total + self.compensation
    }
}

impl Extend<f64> for Sum {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, numbers: I) {
        for x in numbers {
            self.add(x);
        }
    }
}

impl FromIterator<f64> for Sum {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        let mut sum = Self::default();
        sum.extend(numbers);
        sum
    }
}

/// The arithmetic mean by a compensated sum; `None` of nothing.
#[must_use]
pub fn mean(numbers: &[f64]) -> Option<f64> {
    (!numbers.is_empty())
        .then(|| numbers.iter().copied().collect::<Sum>().value() / numbers.len() as f64)
}

/// The unbiased variance Σ(x − x̄)² / (n − 1), in two passes; `None` of fewer than two numbers.
#[must_use]
pub fn variance(numbers: &[f64]) -> Option<f64> {
    let centre = mean(numbers)?;
    let squares: Sum = numbers.iter().map(|x| (x - centre) * (x - centre)).collect();
    (numbers.len() > 1).then(|| squares.value() / (numbers.len() - 1) as f64)
}

/// The quantile at `fraction` in 0..=1 of ascending numbers, linear between order statistics
/// (type 7 of Hyndman and Fan, what numpy gives by default); `None` of nothing.
#[must_use]
pub fn quantile(ascending: &[f64], fraction: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = fraction.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    Some(ascending[below] + (place - below as f64) * (ascending[above] - ascending[below]))
}

/// The standard error of a weighted mean Σwx / Σw from independent blocks,
/// √(n/(n−1) · Σ (w/W)² (x − x̄)²); `None` of fewer than two blocks.
///
/// With equal weights it is the familiar s/√n.
#[must_use]
pub fn standard_error(blocks: &[(f64, f64)]) -> Option<f64> {
    if blocks.len() < 2 {
        return None;
    }
    let weight = blocks.iter().map(|b| b.1).collect::<Sum>().value();
    let centre = blocks.iter().map(|b| b.0 * b.1).collect::<Sum>().value() / weight;
    let squares: Sum = blocks
        .iter()
        .map(|(x, w)| {
            let d = w / weight * (x - centre);
            d * d
        })
        .collect();
    let n = blocks.len() as f64;
    Some((n / (n - 1.0) * squares.value()).sqrt())
}

/// Bits of the mantissa that choose a bin: 256 bins per octave.
const MANTISSA_BITS: u32 = 8;
/// Where a magnitude stops being told from zero: 2^SMALLEST.
const SMALLEST: i64 = -40;
/// Where a magnitude stops being told from larger ones: 2^LARGEST.
const LARGEST: i64 = 24;
const BINS: usize = ((LARGEST - SMALLEST) as usize) << MANTISSA_BITS;
const DROPPED_BITS: u32 = f64::MANTISSA_DIGITS - 1 - MANTISSA_BITS;
const FIRST_KEY: u64 = ((1023 + SMALLEST) as u64) << MANTISSA_BITS;

/// The distribution of a stream of signed numbers in bounded memory (256 KiB).
///
/// Bins grow with the magnitude, 256 to the octave between 2⁻⁴⁰ and 2²⁴, so a quantile is exact
/// to 0.4 % of itself. Smaller magnitudes count as zero, larger ones fall into the outermost bins;
/// minimum and maximum are exact. Order of adding does not
/// matter to quantiles, to the bit.
#[derive(Debug, Clone)]
pub struct Distribution {
    negative: Vec<u64>,
    positive: Vec<u64>,
    zero: u64,
    count: u64,
    minimum: f64,
    maximum: f64,
    sum: Sum,
    squares: Sum,
}

impl Default for Distribution {
    fn default() -> Self {
        Self {
            negative: vec![0; BINS],
            positive: vec![0; BINS],
            zero: 0,
            count: 0,
            minimum: f64::INFINITY,
            maximum: f64::NEG_INFINITY,
            sum: Sum::default(),
            squares: Sum::default(),
        }
    }
}

/// The bin of a magnitude, or `None` for what counts as zero.
fn bin_of(magnitude: f64) -> Option<usize> {
    let key = magnitude.to_bits() >> DROPPED_BITS;
    key.checked_sub(FIRST_KEY).map(|bin| (bin as usize).min(BINS - 1))
}

/// The smallest magnitude in a bin; of `BINS`, the end of the last.
fn edge(bin: usize) -> f64 {
    f64::from_bits((FIRST_KEY + bin as u64) << DROPPED_BITS)
}

impl Distribution {
    /// Adds one number.
    ///
    /// # Panics
    /// Of a NaN, which has no place in an order: the caller has checked.
    pub fn add(&mut self, x: f64) {
        assert!(!x.is_nan(), "a NaN was added to a distribution of {} numbers", self.count);
        match (bin_of(x.abs()), x < 0.0) {
            (None, _) => self.zero += 1,
            (Some(bin), true) => self.negative[bin] += 1,
            (Some(bin), false) => self.positive[bin] += 1,
        }
        self.count += 1;
        self.minimum = self.minimum.min(x);
        self.maximum = self.maximum.max(x);
        self.sum.add(x);
        self.squares.add(x * x);
    }

    /// How many numbers were added.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The exact smallest and largest number; `None` of nothing.
    #[must_use]
    pub fn range(&self) -> Option<(f64, f64)> {
        (self.count > 0).then_some((self.minimum, self.maximum))
    }

    /// The mean; `None` of nothing.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum.value() / self.count as f64)
    }

    /// The variance (divided by n), from compensated sums; `None` of nothing.
    #[must_use]
    pub fn variance(&self) -> Option<f64> {
        let mean = self.mean()?;
        Some((self.squares.value() / self.count as f64 - mean * mean).max(0.0))
    }

    /// The x below which `fraction` of the numbers lie; `None` of nothing.
    #[must_use]
    pub fn quantile(&self, fraction: f64) -> Option<f64> {
        let (minimum, maximum) = self.range()?;
        let wanted = fraction.clamp(0.0, 1.0) * self.count as f64;
        let mut passed = 0.0;
        let bins =
            self.negative.iter().enumerate().rev().map(|(b, &n)| (-edge(b + 1), -edge(b), n));
        let bins = bins.chain([(0.0, 0.0, self.zero)]);
        let bins =
            bins.chain(self.positive.iter().enumerate().map(|(b, &n)| (edge(b), edge(b + 1), n)));
        for (low, high, n) in bins.filter(|b| b.2 > 0) {
            if passed + n as f64 >= wanted {
                let inside = (wanted - passed) / n as f64;
                return Some((low + inside * (high - low)).clamp(minimum, maximum));
            }
            passed += n as f64;
        }
        Some(maximum)
    }

    /// The magnitude below which `fraction` of all magnitudes lie; `None` of nothing.
    #[must_use]
    pub fn magnitude_quantile(&self, fraction: f64) -> Option<f64> {
        let (minimum, maximum) = self.range()?;
        let largest = maximum.abs().max(minimum.abs());
        let wanted = fraction.clamp(0.0, 1.0) * self.count as f64;
        let mut passed = self.zero as f64;
        if passed >= wanted {
            return Some(0.0);
        }
        for bin in 0..BINS {
            let n = (self.negative[bin] + self.positive[bin]) as f64;
            if n > 0.0 && passed + n >= wanted {
                let inside = (wanted - passed) / n;
                return Some((edge(bin) + inside * (edge(bin + 1) - edge(bin))).min(largest));
            }
            passed += n;
        }
        Some(largest)
    }

    /// The empirical distribution function: the fraction of numbers ≤ x, linear inside a bin;
    /// 0 of nothing.
    #[must_use]
    pub fn cumulative(&self, x: f64) -> f64 {
        if self.count == 0 || x < self.minimum {
            return 0.0;
        }
        if x >= self.maximum {
            return 1.0;
        }
        let negatives: u64 = self.negative.iter().sum();
        let below = match (bin_of(x.abs()), x < 0.0) {
            (None, true) => negatives as f64,
            (None, false) => (negatives + self.zero) as f64,
            (Some(bin), true) => negatives as f64 - up_to(&self.negative, bin, x.abs()),
            (Some(bin), false) => {
                (negatives + self.zero) as f64 + up_to(&self.positive, bin, x.abs())
            }
        };
        below / self.count as f64
    }
}

/// The count of magnitudes below `x`, which lies in `bin`.
fn up_to(counts: &[u64], bin: usize, x: f64) -> f64 {
    let whole: u64 = counts[..bin].iter().sum();
    let inside = ((x - edge(bin)) / (edge(bin + 1) - edge(bin))).clamp(0.0, 1.0);
    whole as f64 + inside * counts[bin] as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::random::Stream;

    /// Numbers that cancel keep their small remainder, which a plain sum loses.
    #[test]
    fn sums_are_compensated() {
        let numbers = [1.0, 1e100, 1.0, -1e100];
        assert_eq!(numbers.iter().copied().collect::<Sum>().value(), 2.0);
        assert_eq!(numbers.iter().sum::<f64>(), 0.0);
        let tenths = vec![0.1; 1_000_000];
        assert!((mean(&tenths).unwrap() - 0.1).abs() < 1e-16);
    }

    /// Mean, variance and exact quantiles agree with values worked by hand (and with numpy's).
    #[test]
    fn small_sets_by_hand() {
        let x = [1.0, 2.0, 4.0, 9.0];
        assert_eq!(mean(&x), Some(4.0));
        assert!((variance(&x).unwrap() - 38.0 / 3.0).abs() < 1e-12);
        assert_eq!(quantile(&x, 0.5), Some(3.0));
        assert!((quantile(&x, 0.9).unwrap() - 7.5).abs() < 1e-12);
        assert_eq!(quantile(&x, 1.0), Some(9.0));
        assert_eq!((mean(&[]), variance(&[1.0]), quantile(&[], 0.5)), (None, None, None));
    }

    /// With equal weights the block standard error is s/√n; one block has none.
    #[test]
    fn block_standard_error() {
        let x = [1.0, 2.0, 4.0, 9.0];
        let blocks: Vec<(f64, f64)> = x.iter().map(|&x| (x, 3.0)).collect();
        let expected = (variance(&x).unwrap() / 4.0).sqrt();
        assert!((standard_error(&blocks).unwrap() - expected).abs() < 1e-12);
        assert_eq!(standard_error(&blocks[..1]), None);
    }

    /// Quantiles of the binned distribution stay within its stated 0.4 % of exact ones, for
    /// magnitudes over seven decades and both signs.
    #[test]
    fn distribution_quantiles_are_near_exact_ones() {
        let mut stream = Stream::new(7);
        let mut exact: Vec<f64> = (0..20_000)
            .map(|_| {
                let sign = if stream.uniform() < 0.4 { -1.0 } else { 1.0 };
                sign * 10f64.powf(-7.0 * stream.uniform())
            })
            .collect();
        let mut binned = Distribution::default();
        exact.iter().for_each(|&x| binned.add(x));
        exact.sort_by(f64::total_cmp);
        for fraction in [0.0, 0.001, 0.1, 0.3, 0.5, 0.77, 0.99, 0.999, 1.0] {
            let truth = quantile(&exact, fraction).unwrap();
            let found = binned.quantile(fraction).unwrap();
            assert!((found - truth).abs() <= 0.006 * truth.abs(), "{fraction}: {found} {truth}");
            let back = binned.cumulative(found);
            assert!((back - fraction).abs() < 2e-3, "{fraction} came back as {back}");
        }
        let mut magnitudes: Vec<f64> = exact.iter().map(|x| x.abs()).collect();
        magnitudes.sort_by(f64::total_cmp);
        let truth = quantile(&magnitudes, 0.99).unwrap();
        assert!((binned.magnitude_quantile(0.99).unwrap() - truth).abs() <= 0.005 * truth);
        assert_eq!(binned.range(), Some((exact[0], exact[exact.len() - 1])));
    }

    /// Zeros, tiny, huge and absent numbers all have their place.
    #[test]
    fn distribution_at_its_ends() {
        let empty = Distribution::default();
        assert_eq!((empty.quantile(0.5), empty.range(), empty.cumulative(0.0)), (None, None, 0.0));
        let mut d = Distribution::default();
        [0.0, 1e-300, -0.0, 1e300].iter().for_each(|&x| d.add(x));
        assert_eq!(d.quantile(0.5), Some(0.0));
        assert_eq!(d.magnitude_quantile(0.75), Some(0.0));
        assert_eq!(d.range(), Some((0.0, 1e300)));
        assert_eq!(d.cumulative(0.0), 0.75);
        assert_eq!(d.cumulative(-1.0), 0.0);
        let mut one = Distribution::default();
        one.add(0.3);
        assert_eq!(one.quantile(0.99), Some(0.3));
    }
}
