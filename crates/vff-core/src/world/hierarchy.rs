//! parry's hierarchy of bounding boxes, which its planar and its spatial crate have alike.

/// Defines `Boxes` in terms of `Region`, which says of a body where it is (`of_link`) and which boxes are beyond reach
/// (`is_beyond`).
macro_rules! boxes {
    ($parry:ident, $dimension:literal, $probe:ty, $region:ty, $to_parry:path) => {
        use $parry::bounding_volume::Aabb;
        use $parry::partitioning::{Bvh, BvhBuildStrategy, BvhNode, BvhWorkspace, TraversalAction};

        /// Boxes with their hierarchy.
        #[derive(Clone)]
        pub struct Boxes {
            hierarchy: Bvh,
            workspace: BvhWorkspace,
        }

        impl $crate::world::Hierarchy<$probe, $dimension> for Boxes {
            type Region = $region;

            fn new(boxes: &[[$crate::math::Vector<$dimension>; 2]]) -> Self {
                let boxes: Vec<Aabb> = boxes.iter().copied().map(aabb).collect();
                let hierarchy = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
                Self { hierarchy, workspace: BvhWorkspace::default() }
            }

            fn renew(
                &mut self,
                boxes: impl Iterator<Item = [$crate::math::Vector<$dimension>; 2]>,
                regroup: bool,
            ) {
                for (leaf, renewed) in (0..).zip(boxes) {
                    self.hierarchy.update_partially_if_present(aabb(renewed), leaf, 0.0);
                }
                if regroup {
                    self.hierarchy.rebuild(&mut self.workspace, BvhBuildStrategy::Binned);
                }
                self.hierarchy.refit(&mut self.workspace);
            }

            fn region(link: &$probe) -> Option<$region> {
                <$region>::of_link(link)
            }

            #[inline]
            fn for_each_within(
                &self,
                region: &$region,
                mut limit: f64,
                mut measure: impl FnMut(usize) -> f64,
            ) -> usize {
                let mut count = 0;
                self.hierarchy.traverse(|node| {
                    if region.is_beyond(node, limit) {
                        return TraversalAction::Prune;
                    }
                    if let Some(leaf) = node.leaf_data() {
                        limit = measure(leaf as usize);
                        count += 1;
                    }
                    TraversalAction::Continue
                });
                count
            }
        }

        pub(super) fn aabb([low, high]: [$crate::math::Vector<$dimension>; 2]) -> Aabb {
            Aabb::new($to_parry(low), $to_parry(high))
        }

        impl std::fmt::Debug for Boxes {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_struct("Boxes").finish_non_exhaustive()
            }
        }
    };
}

pub(super) use boxes;
