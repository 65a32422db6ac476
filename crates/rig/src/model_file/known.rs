//! A gauge that is known from elsewhere than recordings: written by hand, or simulated.

use model::sensing::{CHARACTERISTIC_LENGTH_M, Compliance};

use super::{Components, FiveParameter, Frame, NominalAxes, Sensor};

impl Sensor {
    /// A gauge with this sensitivity in S (counts/N, counts/Nm) and a white noise of so many counts. The rest is what nothing was
    /// measured of: no bias, covariance, frame or terms, and baselines of 1 count/Nm.
    pub fn known(name: &str, section: &str, compliance: &Compliance, noise_floor_counts: f64) -> Self {
        Self {
            name: name.to_owned(),
            section: section.to_owned(),
            bias_counts: 0.0,
            bias_sigma_counts: 0.0,
            noise_floor_counts,
            noise_slow_share: 0.0,
            noise_slow_time_s: 0.0,
            residual_rms_counts: noise_floor_counts,
            crosstalk_percent: None,
            crosstalk_length_m: CHARACTERISTIC_LENGTH_M,
            covariance: [[0.0; 7]; 7],
            working_compliance: None,
            compliance: Components::from_array(<[f64; 6]>::from(compliance.vector()).map(Some)),
            compliance_sigma: Components::default(),
            frame: Frame::default(),
            frame_sigma: Frame::default(),
            five_parameter: FiveParameter {
                r_counts_per_nm: 1.0,
                a_x_rad: 0.0,
                a_y_rad: 0.0,
                l_x_m: 0.0,
                l_y_m: 0.0,
                bias_counts: 0.0,
            },
            nominal_axes: NominalAxes { k_counts_per_nm: 1.0, bias_counts: 0.0 },
            centre_counts: 0.0,
            scale_counts: 0.0,
            terms: Vec::new(),
            unobservable: Vec::new(),
        }
    }
}
