//! What one gauge senses: its compliance vector, and the same thing as a scale and a line in space (its actual sensing frame).
//!
//! A bridge answers to the load `L = [f, t]` of its section, about the section's origin in the nominal sensing frame S, as
//!
//! ```text
//! z = C . L + b            C in counts/N (first three) and counts/Nm (last three)
//! ```
//!
//! Seen from S, a bridge that senses one torque is the scale `r` and the line that is the z axis of its actual sensing frame A:
//! with `R = Ry(a_y) Rx(a_x)` (rows R1 R2 R3 = the axes of A in S) and `l = (l_x, l_y, 0)` S's origin seen from A in A's axes,
//!
//! ```text
//! z - b = r (R t + l x R f)_z + r h (R f)_z        C_t = r R3        C_f = r (l_x R2 - l_y R1 + h R3)
//! ```
//!
//! `h` is the pitch: a line has none, a screw has. Source: Kim, Park, Song, "Crosstalk calibration for torque sensor using
//! actual sensing frame", J. Mech. Sci. Technol. 24(8), 2010, with the middle term of its l_y corrected
//! (`sin a_x sin a_y`, which follows from R1) and the pitch added.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Length that compares newtons with newton metres where nothing else is said, m.
pub const CHARACTERISTIC_LENGTH_M: f64 = 0.1;

/// Sensitivity of one gauge to the load of its section, in S: counts/N for force, counts/Nm for moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliance {
    /// Sensitivity to force, counts/N, in S.
    pub force_counts_per_n: Vector3<f64>,
    /// Sensitivity to moment about S's origin, counts/Nm, in S.
    pub moment_counts_per_nm: Vector3<f64>,
}

/// The same gauge as a scale, a line in space and a pitch: its actual sensing frame A seen from S.
///
/// Canonical: `r >= 0`, `a_x` in (-pi, pi], `a_y` in [-pi/2, pi/2]; at `|a_y| = pi/2`, `a_x = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActualFrame {
    /// Scale, counts/Nm about the sensing line.
    pub r_counts_per_nm: f64,
    /// Turn about S's x that comes first, rad.
    pub a_x_rad: f64,
    /// Turn about the y axis that follows, rad.
    pub a_y_rad: f64,
    /// x of S's origin seen from A, in A, m.
    pub l_x_m: f64,
    /// y of S's origin seen from A, in A, m.
    pub l_y_m: f64,
    /// Sensitivity to force along the sensing line over that to torque about it, m.
    pub pitch_m: f64,
}

impl Compliance {
    /// The sensitivities as one vector, force first: counts/N, counts/Nm.
    pub fn vector(&self) -> Vector6<f64> {
        let (f, t) = (&self.force_counts_per_n, &self.moment_counts_per_nm);
        Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
    }

    /// From sensitivities in the order force, moment: counts/N, counts/Nm.
    pub fn from_vector(c: &Vector6<f64>) -> Self {
        Self {
            force_counts_per_n: c.fixed_rows::<3>(0).into_owned(),
            moment_counts_per_nm: c.fixed_rows::<3>(3).into_owned(),
        }
    }

    /// The actual sensing frame; `None` where there is no sensitivity to torque (a force cell has no sensing line).
    pub fn actual_frame(&self) -> Option<ActualFrame> {
        let (f, t) = (&self.force_counts_per_n, &self.moment_counts_per_nm);
        let r = t.norm();
        if r == 0.0 || !r.is_finite() {
            return None;
        }
        let across = t.y.hypot(t.z);
        let a_y = (-t.x).atan2(across);
        // Straight along +-x the first turn does nothing: it is set to zero.
        let a_x = if across == 0.0 { 0.0 } else { wrap_half_open(t.y.atan2(t.z)) };
        let axes = rotation(a_x, a_y);
        let along = |k: usize| (axes.row(k) * f)[0] / r;
        Some(ActualFrame {
            r_counts_per_nm: r,
            a_x_rad: a_x,
            a_y_rad: a_y,
            l_x_m: along(1),
            l_y_m: -along(0),
            pitch_m: along(2),
        })
    }

    /// Crosstalk against the nominal z torque, per cent, with `length_m` to compare N with Nm:
    /// `100 sqrt(C_tx^2 + C_ty^2 + |C_f|^2 / length^2) / |C_tz|`.
    pub fn crosstalk_percent(&self, length_m: f64) -> f64 {
        let t = &self.moment_counts_per_nm;
        let f = self.force_counts_per_n.norm() / length_m;
        100.0 * (t.x * t.x + t.y * t.y + f * f).sqrt() / t.z.abs()
    }

    /// Derivative of `[r, a_x, a_y, l_x, l_y, pitch]` by the compliance vector (rows in that order), for
    /// carrying covariance over; `None` where the frame, or its a_x, is not determined.
    pub fn frame_jacobian(&self) -> Option<Matrix6<f64>> {
        let frame = self.actual_frame()?;
        let (f, t) = (&self.force_counts_per_n, &self.moment_counts_per_nm);
        let across = t.y.hypot(t.z);
        if across == 0.0 {
            return None;
        }
        let r = frame.r_counts_per_nm;
        let d_r = t / r;
        let d_ax = Vector3::new(0.0, t.z, -t.y) / (across * across);
        let d_ay = Vector3::new(-across, t.x * t.y / across, t.x * t.z / across) / (r * r);
        let axes = rotation(frame.a_x_rad, frame.a_y_rad);
        let (by_ax, by_ay) = rotation_derivatives(frame.a_x_rad, frame.a_y_rad);
        let mut j = Matrix6::zeros();
        for (row, d) in [d_r, d_ax, d_ay].iter().enumerate() {
            j.fixed_view_mut::<1, 3>(row, 3).copy_from(&d.transpose());
        }
        for (row, axis, sign, value) in
            [(3, 1, 1.0, frame.l_x_m), (4, 0, -1.0, frame.l_y_m), (5, 2, 1.0, frame.pitch_m)]
        {
            let d_force = axes.row(axis) * (sign / r);
            let turn_x = (by_ax.row(axis) * f)[0] * sign / r;
            let turn_y = (by_ay.row(axis) * f)[0] * sign / r;
            let d_moment = d_ax * turn_x + d_ay * turn_y - d_r * (value / r);
            j.fixed_view_mut::<1, 3>(row, 0).copy_from(&d_force);
            j.fixed_view_mut::<1, 3>(row, 3).copy_from(&d_moment.transpose());
        }
        Some(j)
    }
}

impl ActualFrame {
    /// The compliance vector of this gauge: `C_t = r R3`, `C_f = r (l_x R2 - l_y R1 + h R3)`.
    pub fn compliance(&self) -> Compliance {
        let axes = self.axes();
        let row = |k: usize| axes.row(k).transpose();
        let force = row(1) * self.l_x_m - row(0) * self.l_y_m + row(2) * self.pitch_m;
        Compliance {
            force_counts_per_n: force * self.r_counts_per_nm,
            moment_counts_per_nm: row(2) * self.r_counts_per_nm,
        }
    }

    /// Axes of A as rows, in S; takes components in S to components in A.
    pub fn axes(&self) -> Matrix3<f64> {
        rotation(self.a_x_rad, self.a_y_rad)
    }

    /// The sensing line: its point nearest S's origin (m) and its direction, both in S.
    pub fn line(&self) -> (Vector3<f64>, Vector3<f64>) {
        let axes = self.axes();
        let row = |k: usize| axes.row(k).transpose();
        (-(row(0) * self.l_x_m + row(1) * self.l_y_m), row(2))
    }

    /// The same gauge with `r >= 0` and angles in the canonical range.
    pub fn canonical(&self) -> Self {
        self.compliance().actual_frame().unwrap_or(Self {
            r_counts_per_nm: 0.0,
            a_x_rad: 0.0,
            a_y_rad: 0.0,
            ..*self
        })
    }

    /// The tip wrench's row of the Jacobian rewritten to this actual frame: with `t'` the screw torque
    /// about the actual axis, `t' = row . W_E`; Nm per N and Nm per Nm, in E.
    ///
    /// Paul's column for the z axis of A, from the pose of E seen from A (`n o a` = axes of E in A, `p` its origin):
    /// `[(p x n)_z, (p x o)_z, (p x a)_z, n_z, o_z, a_z]`; a pitch h adds `h [n_z, o_z, a_z]` to the force part.
    /// `r_se` takes components in E to S, `p_se_m` is E's origin seen from S, in S. Source: R. Paul, Robot
    /// Manipulators, 1981, eq. 4.31, as used by Kim, Park, Song.
    pub fn paul_column(&self, r_se: &Matrix3<f64>, p_se_m: &Vector3<f64>) -> Vector6<f64> {
        let axes = self.axes();
        let r_ae = axes * r_se;
        let p_ae = axes * p_se_m + Vector3::new(self.l_x_m, self.l_y_m, 0.0);
        let mut column = Vector6::zeros();
        for k in 0..3 {
            let e = r_ae.column(k);
            column[k] = p_ae.x * e[1] - p_ae.y * e[0] + self.pitch_m * e[2];
            column[3 + k] = e[2];
        }
        column
    }
}

/// `Ry(a_y) Rx(a_x)` as the source writes it: rows are the axes of A in S.
fn rotation(a_x: f64, a_y: f64) -> Matrix3<f64> {
    let ((sx, cx), (sy, cy)) = (a_x.sin_cos(), a_y.sin_cos());
    Matrix3::new(cy, sx * sy, cx * sy, 0.0, cx, -sx, -sy, sx * cy, cx * cy)
}

/// Derivatives of [`rotation`] by `a_x` and by `a_y`.
fn rotation_derivatives(a_x: f64, a_y: f64) -> (Matrix3<f64>, Matrix3<f64>) {
    let ((sx, cx), (sy, cy)) = (a_x.sin_cos(), a_y.sin_cos());
    (
        Matrix3::new(0.0, cx * sy, -sx * sy, 0.0, -sx, -cx, 0.0, cx * cy, -sx * cy),
        Matrix3::new(-sy, sx * cy, cx * cy, 0.0, 0.0, 0.0, -cy, -sx * sy, -cx * sy),
    )
}

/// atan2 gives -pi for (-0.0, -1.0): the canonical range is half open, (-pi, pi].
fn wrap_half_open(angle: f64) -> f64 {
    if angle == -std::f64::consts::PI { std::f64::consts::PI } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn frame(p: [f64; 6]) -> ActualFrame {
        ActualFrame {
            r_counts_per_nm: p[0],
            a_x_rad: p[1],
            a_y_rad: p[2],
            l_x_m: p[3],
            l_y_m: p[4],
            pitch_m: p[5],
        }
    }

    fn values(f: &ActualFrame) -> [f64; 6] {
        [f.r_counts_per_nm, f.a_x_rad, f.a_y_rad, f.l_x_m, f.l_y_m, f.pitch_m]
    }

    proptest! {
        #[test]
        fn compliance_to_frame_to_compliance_is_the_identity(
            c in prop::array::uniform6(-1e6..1e6f64),
        ) {
            let c = Compliance::from_vector(&Vector6::from(c));
            let back = c.actual_frame().unwrap().compliance();
            let error = (back.vector() - c.vector()).amax();
            prop_assert!(error <= 1e-9 * c.vector().amax(), "{error}");
        }

        #[test]
        fn canonical_parameters_come_back(
            r in 1e3..1e6f64, ax in -PI..PI, ay in -1.57..1.57f64, l in prop::array::uniform3(-0.05..0.05f64),
        ) {
            let given = frame([r, ax, ay, l[0], l[1], l[2]]);
            let back = given.compliance().actual_frame().unwrap();
            for (a, b) in values(&given).iter().zip(values(&back)) {
                prop_assert!((a - b).abs() <= 1e-9 * (1.0 + a.abs()), "{given:?} {back:?}");
            }
        }

        #[test]
        fn a_negative_scale_is_the_same_gauge_turned_by_half_a_turn(
            r in 1e3..1e6f64, ax in -PI..0.0, ay in -1.5..1.5f64, l in prop::array::uniform3(-0.05..0.05f64),
        ) {
            let given = frame([-r, ax, ay, l[0], l[1], l[2]]);
            let twin = frame([r, ax + PI, -ay, l[0], -l[1], l[2]]);
            for (a, b) in values(&given.canonical()).iter().zip(values(&twin)) {
                prop_assert!((a - b).abs() <= 1e-9 * (1.0 + b.abs()));
            }
        }

        #[test]
        fn the_line_is_where_a_pure_torque_gauge_feels_no_force(
            r in 1e3..1e6f64, ax in -PI..PI, ay in -1.5..1.5f64, lx in -0.05..0.05f64, ly in -0.05..0.05f64,
            f in prop::array::uniform3(-10.0..10.0f64), along in -1.0..1.0f64,
        ) {
            let gauge = frame([r, ax, ay, lx, ly, 0.0]);
            let (point, direction) = gauge.line();
            let f = Vector3::from(f);
            let t = (point + direction * along).cross(&f);
            let c = gauge.compliance();
            let z = c.force_counts_per_n.dot(&f) + c.moment_counts_per_nm.dot(&t);
            prop_assert!(z.abs() < 1e-8 * r, "{z}");
        }

        #[test]
        fn the_rewritten_jacobian_is_the_compliance_carried_to_the_tip(
            p in prop::array::uniform6(-1.0..1.0f64), turn in prop::array::uniform3(-3.0..3.0f64),
            at in prop::array::uniform3(-1.0..1.0f64), w in prop::array::uniform6(-10.0..10.0f64),
        ) {
            let gauge = frame([1e5 * (1.1 + p[0]), 3.0 * p[1], 1.5 * p[2], 0.02 * p[3], 0.02 * p[4], 0.01 * p[5]]);
            let r_se = *nalgebra::Rotation3::new(Vector3::from(turn)).matrix();
            let p_se = Vector3::from(at);
            let w = Vector6::from(w);
            let f = r_se * w.fixed_rows::<3>(0);
            let t = r_se * w.fixed_rows::<3>(3) + p_se.cross(&f);
            let c = gauge.compliance();
            let direct = c.force_counts_per_n.dot(&f) + c.moment_counts_per_nm.dot(&t);
            let rewritten = gauge.r_counts_per_nm * gauge.paul_column(&r_se, &p_se).dot(&w);
            prop_assert!((direct - rewritten).abs() <= 1e-9 * gauge.r_counts_per_nm * 20.0);
        }

        #[test]
        fn frame_jacobian_is_the_derivative(
            p in prop::array::uniform6(-1.0..1.0f64),
        ) {
            let gauge = frame([1e5 * (1.1 + p[0]), 3.0 * p[1], 1.4 * p[2], 0.02 * p[3], 0.02 * p[4], 0.01 * p[5]]);
            let c = gauge.compliance().vector();
            let j = gauge.compliance().frame_jacobian().unwrap();
            let at = |c: &Vector6<f64>| Vector6::from(values(&Compliance::from_vector(c).actual_frame().unwrap()));
            for k in 0..6 {
                let step = 1e-5 * gauge.r_counts_per_nm;
                let (mut up, mut down) = (c, c);
                up[k] += step;
                down[k] -= step;
                let numeric = (at(&up) - at(&down)) / (2.0 * step);
                for row in 0..6 {
                    let scale = if row == 0 { 1.0 } else { 1.0 / gauge.r_counts_per_nm };
                    prop_assert!((numeric[row] - j[(row, k)]).abs() <= 1e-4 * scale, "{row} {k} {} {}", numeric[row], j[(row, k)]);
                }
            }
        }
    }

    #[test]
    fn a_force_cell_has_no_sensing_line() {
        let c = Compliance::from_vector(&Vector6::new(1.0, 2.0, 3.0, 0.0, 0.0, 0.0));
        assert_eq!(c.actual_frame(), None);
        assert_eq!(c.frame_jacobian(), None);
    }

    #[test]
    fn straight_along_x_the_first_turn_is_zero() {
        let c = Compliance::from_vector(&Vector6::new(10.0, 20.0, 30.0, -5.0, 0.0, 0.0));
        let f = c.actual_frame().unwrap();
        assert_eq!((f.a_x_rad, f.a_y_rad), (0.0, FRAC_PI_2));
        assert!((f.compliance().vector() - c.vector()).amax() < 1e-12);
    }

    #[test]
    fn a_gauge_wired_backwards_has_a_x_of_pi() {
        let c = Compliance::from_vector(&Vector6::new(0.0, 0.0, 0.0, 0.0, -0.0, -7.0));
        let f = c.actual_frame().unwrap();
        assert_eq!((f.r_counts_per_nm, f.a_x_rad, f.a_y_rad.abs()), (7.0, PI, 0.0));
    }

    #[test]
    fn crosstalk_uses_its_length() {
        let c = Compliance::from_vector(&Vector6::new(0.3, 0.0, 0.0, 0.0, 4.0, 10.0));
        assert!((c.crosstalk_percent(0.1) - 50.0).abs() < 1e-12);
    }
}
