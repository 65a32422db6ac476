//! Lines in spectra: which frequencies, or orders of an angle, stand out of their neighbourhood.

use std::f64::consts::TAU;

/// A line stands out of the median of its neighbourhood by at least this factor: of thousands of bins of noise none does.
const STANDS_OUT: f64 = 14.0;
/// Bins to each side that are a line's neighbourhood.
const NEIGHBOURS: usize = 30;

/// Frequencies (Hz, above `lowest_hz`) of the strongest lines of evenly sampled pieces, the strongest first.
pub(crate) fn lines_hz(pieces: &[&[f64]], step_s: f64, lowest_hz: f64, most: usize) -> Vec<f64> {
    let Some(longest) = pieces.iter().map(|piece| piece.len()).max().filter(|longest| *longest >= 64) else {
        return Vec::new();
    };
    let size = (2 * longest).next_power_of_two();
    let mut power = vec![0.0; size / 2];
    for piece in pieces {
        let mean = piece.iter().sum::<f64>() / piece.len().max(1) as f64;
        let mut values = vec![(0.0, 0.0); size];
        for (k, value) in piece.iter().enumerate() {
            // J. von Hann's window: what is slow must not leak into what is fast.
            let window = 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / piece.len() as f64).cos();
            values[k].0 = (value - mean) * window;
        }
        transform(&mut values);
        power.iter_mut().zip(&values).for_each(|(sum, (re, im))| *sum += re * re + im * im);
    }
    let bin_hz = 1.0 / (size as f64 * step_s);
    let first = (lowest_hz / bin_hz).ceil() as usize;
    peaks(&power, first, most).into_iter().map(|bin| bin * bin_hz).collect()
}

/// Mean square of evenly sampled pieces (at `rate_hz`) that lies between neighbouring edges (Hz, ascending).
pub(crate) fn bands(pieces: &[&[f64]], rate_hz: f64, edges_hz: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; edges_hz.len().saturating_sub(1)];
    let values = pieces.iter().map(|piece| piece.len()).sum::<usize>().max(1) as f64;
    for piece in pieces.iter().filter(|piece| piece.len() > 1) {
        let size = piece.len().next_power_of_two();
        let mut spectrum = vec![(0.0, 0.0); size];
        for (k, value) in piece.iter().enumerate() {
            // The mean square of J. von Hann's window is 3/8.
            let window = (0.5 - 0.5 * (TAU * (k as f64 + 0.5) / piece.len() as f64).cos()) / 0.375_f64.sqrt();
            spectrum[k].0 = value * window;
        }
        transform(&mut spectrum);
        for (bin, (re, im)) in spectrum[..=size / 2].iter().enumerate() {
            let hz = bin as f64 * rate_hz / size as f64;
            let twice = if bin == 0 || bin == size / 2 { 1.0 } else { 2.0 };
            // The last edge belongs to the last band.
            let band = edges_hz.iter().skip(1).position(|edge| hz < *edge).or(sums.len().checked_sub(1));
            if let Some(sum) = band.and_then(|band| sums.get_mut(band)) {
                *sum += twice * (re * re + im * im) / size as f64;
            }
        }
    }
    sums.iter().map(|sum| sum / values).collect()
}

/// Local maxima that stand out of their neighbourhood, between bins, the strongest first.
pub(crate) fn peaks(power: &[f64], first: usize, most: usize) -> Vec<f64> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    for at in first.max(1)..power.len().saturating_sub(1) {
        if power[at] < power[at - 1] || power[at] < power[at + 1] {
            continue;
        }
        let near = at.saturating_sub(NEIGHBOURS)..(at + NEIGHBOURS + 1).min(power.len());
        let mut around: Vec<f64> = power[near].to_vec();
        let middle = around.len() / 2;
        let median = *around.select_nth_unstable_by(middle, f64::total_cmp).1;
        if power[at] > STANDS_OUT * median {
            found.push((power[at], between(&power[at - 1..=at + 1]) + at as f64));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(most).map(|(_, bin)| bin).collect()
}

/// Top of the parabola through three logarithms, against the middle one.
fn between(three: &[f64]) -> f64 {
    let [a, b, c] = [three[0], three[1], three[2]].map(|power| power.max(f64::MIN_POSITIVE).ln());
    let curve = a - 2.0 * b + c;
    if curve < 0.0 { (0.5 * (a - c) / curve).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Fast Fourier transform in place (J. Cooley, J. Tukey, Math. Comp. 19, 1965); the length must be a power of two.
fn transform(values: &mut [(f64, f64)]) {
    let n = values.len();
    let bits = n.trailing_zeros();
    for k in 0..n {
        let mirrored = k.reverse_bits() >> (usize::BITS - bits.max(1));
        if mirrored > k {
            values.swap(k, mirrored);
        }
    }
    let mut half = 1;
    while half < n {
        let (sin, cos) = (-TAU / (2 * half) as f64).sin_cos();
        for start in (0..n).step_by(2 * half) {
            let mut turn = (1.0, 0.0);
            for k in start..start + half {
                let (a, b) = (values[k], values[k + half]);
                let b = (b.0 * turn.0 - b.1 * turn.1, b.0 * turn.1 + b.1 * turn.0);
                values[k] = (a.0 + b.0, a.1 + b.1);
                values[k + half] = (a.0 - b.0, a.1 - b.1);
                turn = (turn.0 * cos - turn.1 * sin, turn.0 * sin + turn.1 * cos);
            }
        }
        half *= 2;
    }
}

/// Power of whole cycles per turn in values over an angle (rad): per order (from 0) `|sum of v exp(-i n q)|^2`.
pub(crate) fn power_by_order(angle_rad: &[f64], values: &[f64], orders: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); orders];
    for (angle, value) in angle_rad.iter().zip(values).filter(|(_, value)| **value != 0.0) {
        let (sin, cos) = angle.sin_cos();
        let mut turn = (*value, 0.0);
        for sum in &mut sums {
            *sum = (sum.0 + turn.0, sum.1 + turn.1);
            turn = (turn.0 * cos - turn.1 * sin, turn.0 * sin + turn.1 * cos);
        }
    }
    sums.into_iter().map(|(re, im)| re * re + im * im).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        let mut z = (k as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((z ^ (z >> 27)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn a_hum_under_noise_is_found_between_the_bins() {
        let step_s = 0.008;
        let piece = |seed: usize| -> Vec<f64> {
            (0..3000)
                .map(|k| 0.3 * (TAU * 49.987 * k as f64 * step_s + seed as f64).sin() + noise(k + seed))
                .collect()
        };
        let (a, b) = (piece(1), piece(5000));
        let found = lines_hz(&[&a, &b], step_s, 3.0, 2);
        assert!(found.len() == 1 && (found[0] - 49.987).abs() < 0.01, "{found:?}");
        let silent: Vec<f64> = (0..3000).map(noise).collect();
        assert_eq!(lines_hz(&[&silent], step_s, 3.0, 2), [0.0; 0]);
    }

    #[test]
    fn bands_hold_the_mean_square_of_what_swings_in_them() {
        let rate_hz = 100.0;
        let piece: Vec<f64> = (0..5000)
            .map(|k| {
                2.0 * (TAU * 1.3 * f64::from(k) / rate_hz).sin() + (TAU * 20.0 * f64::from(k) / rate_hz).cos()
            })
            .collect();
        let found = bands(&[&piece], rate_hz, &[0.0, 1.0, 2.0, 10.0, 50.0]);
        for (found, expected) in found.iter().zip([0.0, 2.0, 0.0, 0.5]) {
            assert!((found - expected).abs() < 0.02, "{found} for {expected}");
        }
        assert_eq!(bands(&[], rate_hz, &[0.0, 1.0]), [0.0]);
    }

    #[test]
    fn a_ripple_of_an_angle_is_found() {
        let angle: Vec<f64> = (0..4000).map(|k| (f64::from(k) * 0.003).sin() * 1.3).collect();
        let values: Vec<f64> =
            angle.iter().enumerate().map(|(k, q)| 0.4 * (101.0 * q).sin() + noise(k)).collect();
        let found = peaks(&power_by_order(&angle, &values, 200), 3, 1);
        assert!(found.len() == 1 && (found[0] - 101.0).abs() < 0.8, "{found:?}");
    }
}
