//! The plots of a sweep, as SVG: error against time of all settings, and a panel per knob.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::combinators::WithKeyPoints;
use plotters::prelude::*;

use super::front::Point;

/// A setting in a plot.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Seconds and relative error.
    pub point: Point,
    /// Relative bias: the error that more directions or rays would not take away.
    pub bias: f64,
    /// What is written beside it.
    pub label: String,
    /// Which colour it has: a name of the legend.
    pub group: String,
    /// Is it the scene's own settings?
    pub is_own: bool,
}

/// The settings that are values of one knob, in their order.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The knob.
    pub title: String,
    /// Its values.
    pub marks: Vec<Mark>,
}

type Area<'s> = DrawingArea<SVGBackend<'s>, Shift>;
type Outcome = Result<(), DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>>;

const PANEL: (u32, u32) = (340, 280);
const PANEL_COLUMNS: usize = 3;
const GREY: RGBColor = RGBColor(120, 120, 120);

fn svg(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Outcome) -> String {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE).and_then(|()| draw(&area)).and_then(|()| area.present()).expect("a string takes any drawing");
    }
    text
}

/// A range that holds all values above zero, with some room.
fn range(values: impl Iterator<Item = f64>) -> Range<f64> {
    let usable = values.filter(|v| *v > 0.0 && v.is_finite());
    let (low, high) = usable.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    if high > 0.0 { low / 1.4..high * 1.4 } else { 0.1..10.0 }
}

/// A logarithmic axis with ticks at 1, 2 and 5 of every decade.
fn logarithmic(range: Range<f64>) -> WithKeyPoints<LogCoord<f64>> {
    let decades = range.start.log10().floor() as i32..=range.end.log10().ceil() as i32;
    let ticks = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(d)));
    let inside: Vec<f64> = ticks.filter(|t| range.contains(t)).collect();
    range.log_scale().with_key_points(inside)
}

/// `0.012`, `1.2`, `12`: two digits, no zeros at the end.
fn short(value: &f64) -> String {
    let digits = (1 - value.abs().max(1e-6).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Error against time of all `marks` by a clock of this name; `front` are indices of them, the fastest first.
pub fn front_plot(marks: &[Mark], front: &[usize], clock: &str) -> String {
    let mut groups: Vec<&str> = Vec::new();
    for mark in marks {
        if !groups.contains(&&mark.group[..]) {
            groups.push(&mark.group);
        }
    }
    svg((860, 520), |area| {
        let x = range(marks.iter().map(|m| m.point.time));
        let y = range(marks.iter().map(|m| 100.0 * m.point.error));
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(58)
            .build_cartesian_2d(logarithmic(x), logarithmic(y))?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc(format!("{clock} of a picture, s"))
            .y_desc("error, %")
            .x_label_formatter(&short)
            .y_label_formatter(&short)
            .draw()?;
        let at = |m: &Mark| (m.point.time, 100.0 * m.point.error);
        chart.draw_series(LineSeries::new(front.iter().map(|&i| at(&marks[i])), GREY.stroke_width(2)))?;
        for (g, group) in groups.iter().enumerate() {
            let color = Palette99::pick(g).to_rgba();
            let of_group = marks.iter().filter(|m| m.group == *group);
            chart
                .draw_series(of_group.map(|m| Circle::new(at(m), 4, color.filled())))?
                .label(*group)
                .legend(move |(x, y)| Circle::new((x + 8, y), 4, color.filled()));
        }
        let own = marks.iter().filter(|m| m.is_own);
        chart
            .draw_series(own.map(|m| Circle::new(at(m), 8, BLACK.stroke_width(2))))?
            .label("the scene's own settings")
            .legend(|(x, y)| Circle::new((x + 8, y), 6, BLACK.stroke_width(2)));
        chart.draw_series(front.iter().map(|&i| {
            let m = &marks[i];
            EmptyElement::at(at(m)) + Text::new(m.label.clone(), (8, -14), ("sans-serif", 11))
        }))?;
        chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(GREY).draw()
    })
}

/// A line of [`size_plot`].
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Items, and 10⁹ items per second.
    pub points: Vec<(f64, f64)>,
}

/// Items per second against the number of items.
pub fn size_plot(curves: &[Curve]) -> String {
    svg((860, 520), |area| {
        let points = || curves.iter().flat_map(|c| &c.points);
        let (x, y) = (range(points().map(|p| p.0)), range(points().map(|p| p.1)));
        let sizes: Vec<f64> = (0..32).map(|e| 2f64.powi(e)).filter(|n| x.contains(n)).collect();
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(58)
            .build_cartesian_2d(x.log_scale().with_key_points(sizes), logarithmic(y))?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc("items")
            .y_desc("10⁹ items per second")
            .x_label_formatter(&|n| format!("2^{}", n.log2().round()))
            .y_label_formatter(&short)
            .draw()?;
        for (i, curve) in curves.iter().enumerate() {
            let color = Palette99::pick(i).to_rgba();
            chart
                .draw_series(LineSeries::new(curve.points.iter().copied(), color.stroke_width(2)).point_size(3))?
                .label(&curve.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
        }
        let corner = SeriesLabelPosition::LowerRight;
        chart.configure_series_labels().position(corner).background_style(WHITE.mix(0.8)).border_style(GREY).draw()
    })
}

/// Error against time along every knob, all on the same axes: dots are the error, rings the bias.
pub fn knob_plot(panels: &[Panel], clock: &str) -> String {
    let all = || panels.iter().flat_map(|p| &p.marks);
    let x = range(all().map(|m| m.point.time));
    let errors = range(all().map(|m| 100.0 * m.point.error));
    // A bias of nothing has no place on a logarithmic axis: it stands at the foot.
    let foot = errors.start / 10.0;
    let rows = panels.len().div_ceil(PANEL_COLUMNS).max(1);
    let columns = panels.len().clamp(1, PANEL_COLUMNS);
    svg((PANEL.0 * columns as u32, PANEL.1 * rows as u32), |area| {
        for (panel, area) in panels.iter().zip(area.split_evenly((rows, columns))) {
            let mut chart = ChartBuilder::on(&area)
                .caption(&panel.title, ("sans-serif", 15))
                .margin(8)
                .x_label_area_size(34)
                .y_label_area_size(46)
                .build_cartesian_2d(logarithmic(x.clone()), logarithmic(foot / 1.2..errors.end))?;
            chart
                .configure_mesh()
                .light_line_style(WHITE)
                .x_desc(format!("{clock}, s"))
                .y_desc("error (dots), bias (rings), %")
                .x_label_formatter(&short)
                .y_label_formatter(&short)
                .draw()?;
            let error = |m: &Mark| (m.point.time, 100.0 * m.point.error);
            let bias = |m: &Mark| (m.point.time, (100.0 * m.bias).max(foot));
            chart.draw_series(LineSeries::new(panel.marks.iter().map(error), GREY))?;
            chart.draw_series(panel.marks.iter().map(|m| {
                let color = if m.is_own { BLACK } else { BLUE };
                EmptyElement::at(error(m))
                    + Circle::new((0, 0), 4, color.filled())
                    + Text::new(m.label.clone(), (6, -14), ("sans-serif", 11))
            }))?;
            chart.draw_series(panel.marks.iter().map(|m| {
                let color = if m.is_own { BLACK } else { BLUE };
                Circle::new(bias(m), 4, color.stroke_width(1))
            }))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(time: f64, error: f64) -> Mark {
        let point = Point { time, error };
        Mark { point, bias: 0.0, label: "<8>".into(), group: "phase".into(), is_own: time == 1.0 }
    }

    #[test]
    fn plots_show_every_mark_and_escape_labels() {
        let marks = vec![mark(1.0, 0.1), mark(2.0, 0.05), mark(4.0, 0.2)];
        let front = front_plot(&marks, &[0, 1], "GPU time");
        assert_eq!(front.matches("<circle").count(), 3 + 1 + 2, "marks, own, legend: {front}");
        assert!(front.contains("&lt;8&gt;") && !front.contains("<8>"));
        let panel = Panel { title: "directions".into(), marks };
        assert_eq!(knob_plot(&[panel], "GPU time").matches("<circle").count(), 6);
    }

    #[test]
    fn plots_of_little_are_drawn() {
        for marks in [vec![], vec![mark(1.0, 0.0)], vec![mark(1.0, 0.1)]] {
            assert!(front_plot(&marks, &[], "GPU time").starts_with("<svg"));
            assert!(knob_plot(&[Panel { title: "spp".into(), marks }], "GPU time").starts_with("<svg"));
        }
        assert!(knob_plot(&[], "GPU time").starts_with("<svg"));
    }

    #[test]
    fn labels_are_short() {
        let text: Vec<_> = [0.0123, 0.5, 1.25, 12.0, 1234.0].iter().map(short).collect();
        assert_eq!(text, ["0.012", "0.5", "1.2", "12", "1234"]);
    }
}
