//! How much of something goes with the angle of a joint.

use nalgebra::{Matrix3, Vector3};

/// Share (0 .. 1) of the variance of `values` that a constant, a sine and a cosine of the angles (rad) take away: what an
/// encoder's zero, a mass or a tilt that is off leaves behind; none for fewer than eight values or where nothing varies.
pub fn share_of_angle(angles_rad: &[f64], values: &[f64]) -> Option<f64> {
    let n = values.len();
    if n < 8 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let total: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (angle, value) in angles_rad.iter().zip(values) {
        let row = Vector3::new(1.0, angle.sin(), angle.cos());
        normal += row * row.transpose();
        right += row * (value - mean);
    }
    // A joint that hardly moved shows nothing: its sine and cosine are constants too.
    let pseudo = normal.svd(true, true).pseudo_inverse(1e-6 * n as f64).ok()?;
    let explained = right.dot(&(pseudo * right));
    (total > 0.0).then(|| (explained / total).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_is_all_of_the_angle_and_noise_next_to_none() {
        let angles: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.618).collect();
        let wave: Vec<f64> = angles.iter().map(|q| 3.0 + 2.0 * (q - 0.4).sin()).collect();
        assert!(share_of_angle(&angles, &wave).unwrap() > 1.0 - 1e-9);
        let other: Vec<f64> = (0..400).map(|k| (f64::from(k) * 1.7).sin()).collect();
        assert!(share_of_angle(&angles, &other).unwrap() < 0.05);
        assert!(
            share_of_angle(&[0.3; 400], &other).unwrap() < 1e-9,
            "a joint that stands still explains nothing"
        );
        assert_eq!(share_of_angle(&angles[..4], &wave[..4]), None);
        assert_eq!(share_of_angle(&angles, &[1.0; 400]), None);
    }
}
