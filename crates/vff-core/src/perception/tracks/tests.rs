//! Balls that are out of sight, or taken up.

use super::*;
use crate::geometry::directions;

/// A ball that has been seen often enough, at rest with its middle in the origin.
fn ball_at_rest(settings: &PerceiverSettings) -> Tracks {
    let points: Vec<Vector<3>> = directions(100).map(|away| away * 0.08).collect();
    let mut cluster = Cluster::new();
    cluster.corners = [Vector::repeat(-0.08), Vector::repeat(0.08)];
    (cluster.points, cluster.cells) = (100, 100);
    let mut body = Body::new(0, 0, &cluster, 0.0, settings);
    for k in 1..10 {
        let t = f64::from(k) / 30.0;
        body.predict(t, settings.acceleration);
        body.follow(&cluster, t, settings);
        body.follow_ball(&cluster, &points, settings);
    }
    Tracks { bodies: vec![body], ..Tracks::default() }
}

/// A ball that reaches into what the arm has taken up is none any more; one beside it is.
#[test]
fn what_is_taken_up_is_no_ball() {
    let settings = PerceiverSettings { hidden: 0.3, ..PerceiverSettings::default() };
    let mut tracks = ball_at_rest(&settings);
    let load = |x: f64| move |place: &Vector<3>| (place - Vector::x() * x).norm() - 0.05;
    for (place, left) in [(0.2, 1), (0.1, 0)] {
        tracks.take_up(0.3, load(place));
        assert_eq!(tracks.round(0.3).len(), left, "{place}");
    }
}

/// A ball is expected where it went for a while, and no farther.
#[test]
fn a_ball_out_of_sight_is_expected_near_where_it_was_seen() {
    let settings = PerceiverSettings { hidden: 0.3, ..PerceiverSettings::default() };
    let mut tracks = ball_at_rest(&settings);
    let body = &mut tracks.bodies[0];
    body.ball.as_mut().unwrap().centre.velocity = Vector::x();
    for (t, gone) in [(0.4, 0.1), (0.6, 0.3), (1.5, COASTS)] {
        body.predict(t, settings.acceleration);
        let expected = body.expected(t).unwrap();
        let off = expected.distance_on(&Vector::<3>::new(gone + 0.08, 0.0, 0.0), settings.voxel);
        assert!(off.is_some_and(|off| off < 1e-3), "{t}: {off:?}");
    }
    assert!((body.track().position - Vector::zeros()).norm() < 1e-3);
}
