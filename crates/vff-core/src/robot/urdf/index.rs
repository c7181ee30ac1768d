//! Which link hangs on which joint.

use super::error::UrdfError;
use super::role::Role;
use super::tree::{Tree, TreeJoint};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// The tree with its names resolved.
pub(super) struct Index<'a> {
    pub tree: &'a Tree,
    pub links: HashMap<&'a str, usize>,
    pub joints: HashMap<&'a str, usize>,
    /// The joint above each link.
    pub above: Vec<Option<usize>>,
    /// The joints below each link, in the order of the file.
    pub below: Vec<Vec<usize>>,
    pub root: usize,
}

fn index<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a String>,
) -> Result<HashMap<&'a str, usize>, UrdfError> {
    let mut found = HashMap::new();
    for (i, name) in names.enumerate() {
        if found.insert(name.as_str(), i).is_some() {
            return Err(UrdfError::Twice { what, name: name.clone() });
        }
    }
    Ok(found)
}

impl<'a> Index<'a> {
    pub fn new(tree: &'a Tree) -> Result<Self, UrdfError> {
        let links = index("link", tree.links.iter().map(|link| &link.name))?;
        let joints = index("joint", tree.joints.iter().map(|joint| &joint.name))?;
        if links.is_empty() {
            return Err(UrdfError::Empty);
        }
        let mut above = vec![None; tree.links.len()];
        let mut below = vec![vec![]; tree.links.len()];
        for (j, joint) in tree.joints.iter().enumerate() {
            let end = |name: &str| {
                links.get(name).copied().ok_or_else(|| {
                    unknown(&format!("joint `{}`", joint.name), "link", name, &tree.link_names())
                })
            };
            below[end(&joint.parent)?].push(j);
            let child = end(&joint.child)?;
            if let Some(first) = above[child].replace(j) {
                return Err(UrdfError::TwoParents {
                    link: joint.child.clone(),
                    first: tree.joints[first].name.clone(),
                    second: joint.name.clone(),
                });
            }
        }
        let mut index = Self { tree, links, joints, above, below, root: 0 };
        // Every link has at most one joint above: what no root leads to lies on or below a circle.
        let roots: Vec<_> = (0..tree.links.len()).filter(|&i| index.above[i].is_none()).collect();
        let mut reached = BTreeSet::new();
        for &root in &roots {
            index.walk(root, |link| {
                reached.insert(link);
            });
        }
        if let Some(lost) = (0..tree.links.len()).find(|link| !reached.contains(link)) {
            return Err(UrdfError::Cycle { links: index.circle_above(lost) });
        }
        if roots.len() > 1 {
            return Err(UrdfError::SeveralRoots { roots: index.names(roots) });
        }
        index.root = roots[0];
        Ok(index)
    }

    pub fn names(&self, links: impl IntoIterator<Item = usize>) -> Vec<String> {
        links.into_iter().map(|link| self.tree.links[link].name.clone()).collect()
    }

    /// Visits a link and all below, parents first.
    pub fn walk(&self, from: usize, mut visit: impl FnMut(usize)) {
        let mut open = vec![from];
        while let Some(link) = open.pop() {
            visit(link);
            open.extend(self.below[link].iter().rev().map(|&joint| self.child(joint)));
        }
    }

    pub fn child(&self, joint: usize) -> usize {
        self.links[self.tree.joints[joint].child.as_str()]
    }

    pub fn parent(&self, joint: usize) -> usize {
        self.links[self.tree.joints[joint].parent.as_str()]
    }

    /// The circle that is met going up from a link.
    pub fn circle_above(&self, mut link: usize) -> Vec<String> {
        let up = |link: usize| self.above[link].map_or(link, |joint| self.parent(joint));
        for _ in 0..self.above.len() {
            link = up(link);
        }
        let mut circle = vec![link];
        let mut next = up(link);
        while next != link {
            circle.push(next);
            next = up(next);
        }
        self.names(circle.into_iter().rev())
    }

    pub fn link(&self, place: &str, name: &str) -> Result<usize, UrdfError> {
        let found = self.links.get(name).copied();
        found.ok_or_else(|| unknown(place, "link", name, &self.tree.link_names()))
    }

    pub fn joint(&self, place: &str, name: &str) -> Result<usize, UrdfError> {
        let found = self.joints.get(name).copied();
        found.ok_or_else(|| unknown(place, "joint", name, &self.tree.joint_names()))
    }

    /// The link to end at: the one that is named, else the only one without children.
    pub fn tip(&self, base: usize, named: Option<&str>) -> Result<usize, UrdfError> {
        if let Some(name) = named {
            return self.link("tip", name);
        }
        let mut leaves = vec![];
        self.walk(base, |link| {
            if self.below[link].is_empty() {
                leaves.push(link);
            }
        });
        match leaves[..] {
            [tip] => Ok(tip),
            _ => {
                let joints = |leaf: &usize| {
                    let chain = self.chain(base, *leaf).unwrap_or_default();
                    chain.iter().filter(|joint| self.tree.joints[**joint].moves().is_some()).count()
                };
                leaves.sort_by_cached_key(|leaf| {
                    (Role::of(&self.tree.links[*leaf].name), Reverse(joints(leaf)))
                });
                let base = self.tree.links[base].name.clone();
                Err(UrdfError::WhichTip { base, leaves: self.names(leaves) })
            }
        }
    }

    /// The joints from the base to the tip.
    pub fn chain(&self, base: usize, tip: usize) -> Result<Vec<usize>, UrdfError> {
        let mut joints = vec![];
        let mut link = tip;
        while link != base {
            let Some(joint) = self.above[link] else {
                let above = joints.iter().rev().map(|&joint| self.parent(joint));
                return Err(UrdfError::NotBelow {
                    tip: self.tree.links[tip].name.clone(),
                    base: self.tree.links[base].name.clone(),
                    above: self.names(above),
                });
            };
            joints.push(joint);
            link = self.parent(joint);
        }
        joints.reverse();
        Ok(joints)
    }

    /// Where a joint that does not move stands: as told, as its driver implies, or at 0.
    pub fn standing(
        &self,
        joint: usize,
        moving: &BTreeSet<usize>,
        told: &BTreeMap<String, f64>,
    ) -> Result<f64, UrdfError> {
        let (mut factor, mut offset, mut at) = (1.0, 0.0, joint);
        for _ in 0..=self.tree.joints.len() {
            let TreeJoint { name, mimic, .. } = &self.tree.joints[at];
            if let Some(value) = told.get(name) {
                return Ok(factor * value + offset);
            }
            if moving.contains(&at) {
                let joint = self.tree.joints[joint].name.clone();
                return Err(UrdfError::MimicOfMoving { joint, driver: name.clone() });
            }
            let Some(mimic) = mimic else { return Ok(offset) };
            offset += factor * mimic.offset;
            factor *= mimic.multiplier;
            at = self.joint(&format!("joint `{name}`, <mimic>"), &mimic.joint)?;
        }
        Err(UrdfError::MimicCycle(self.tree.joints[joint].name.clone()))
    }
}

/// Nothing of that name.
pub(super) fn unknown(place: &str, what: &'static str, given: &str, known: &[String]) -> UrdfError {
    UrdfError::Unknown { place: place.into(), what, given: given.into(), known: known.to_vec() }
}
