//! How links compare with each other, for drawings.

use super::Link;

/// How the links of a registration compare with each other: four grades of residual, whose bounds are 1, 1.5 and 2 times the median, so that what
/// stands out is seen whatever the scanner; and three of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grades {
    median: f64,
    most: u64,
}

impl Grades {
    /// Of these links; `None` if there are none.
    pub fn of(links: &[Link]) -> Option<Self> {
        let mut residuals: Vec<f64> = links.iter().map(|link| link.residual).collect();
        residuals.sort_unstable_by(f64::total_cmp);
        let median = *residuals.get(residuals.len().saturating_sub(1) / 2)?;
        Some(Self { median, most: links.iter().map(|link| link.samples).max().unwrap_or(0) })
    }

    /// Largest residuals of all grades but the last, metres.
    pub fn bounds(&self) -> [f64; 3] {
        [1.0, 1.5, 2.0].map(|times| times * self.median)
    }

    /// The grade of a link's residual: 0 to 3, the last one the worst.
    pub fn residual(&self, link: &Link) -> usize {
        self.bounds().iter().take_while(|bound| link.residual > **bound).count()
    }

    /// The grade of its number of samples: 0 below a tenth of the most that a link has, 1 below four tenths, 2 else.
    pub fn samples(&self, link: &Link) -> usize {
        [0.1, 0.4].iter().take_while(|share| link.samples as f64 >= **share * self.most as f64).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(residual: f64, samples: u64) -> Link {
        let stations = ["a".to_owned(), "b".to_owned()];
        Link { stations, overlap: 0.5, samples, residual, contradicted: 0.0, sigma: None }
    }

    #[test]
    fn links_are_graded_by_their_residual_relative_to_the_median() {
        let links = [(0.001, 1000), (0.0005, 399), (0.0014, 400), (0.0021, 99), (0.0009, 100)];
        let links = links.map(|(residual, samples)| link(residual, samples));
        let grades = Grades::of(&links).unwrap();
        assert_eq!(grades.bounds(), [0.001, 0.0015, 0.002]);
        assert_eq!(links.each_ref().map(|link| grades.residual(link)), [0, 0, 1, 3, 0]);
        assert_eq!(links.each_ref().map(|link| grades.samples(link)), [2, 1, 2, 0, 1]);
        assert_eq!(Grades::of(&[]), None);
    }
}
