//! A way out of long computations: inner loops report what they have done, and whoever waits for the result is asked
//! now and then whether it is still wanted.
//!
//! A report costs a few instructions; nobody is asked before about a millisecond of work is done, and nobody at all
//! outside [`watched`]. If the answer is no, the stack is unwound up to there (as salsa cancels a query), so that no
//! loop has to hand the interruption on. What was being computed is lost, and an object that was being changed must
//! not be used again before it is rebuilt.

#[cfg(feature = "parallel")]
use rayon::ThreadPool;
use std::cell::{Cell, RefCell};
use std::mem;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
#[cfg(any(feature = "parallel", test))]
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Work between two looks at the clock, in multiplications: about a millisecond.
const QUANTUM: usize = 1 << 20;
/// How often is asked.
const EVERY: Duration = Duration::from_millis(20);

/// The computation was ended from outside.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use std::sync::atomic::{AtomicBool, Ordering};
/// use vff_core::interrupt::{self, Interrupted, Watch};
///
/// let stop = Arc::new(AtomicBool::new(false));
/// stop.store(true, Ordering::Relaxed);
/// let endless = || loop { interrupt::checkpoint(1 << 20) };
/// let ended: Result<(), _> = interrupt::watched(Watch::Flag(stop), endless);
/// assert!(matches!(ended, Err(Interrupted)));
/// ```
///
/// # See also
/// [`Aside`] and [`Parts`], for what is left to another thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted;

/// How a thread learns whether its work is still wanted.
#[derive(Debug, Clone)]
pub enum Watch {
    /// It asks, about every 20 ms; false ends the work.
    Ask(fn() -> bool),
    /// Somebody else sets this.
    Flag(Arc<AtomicBool>),
}

impl Watch {
    fn is_wanted(&self) -> bool {
        match self {
            Self::Ask(ask) => ask(),
            Self::Flag(flag) => !flag.load(Ordering::Relaxed),
        }
    }
}

thread_local! {
    /// Work left until the next look at the clock. Without a watch it never runs out.
    static LEFT: Cell<usize> = const { Cell::new(usize::MAX) };
    /// All work that could have been done until nothing was left, so that this less what is left is what was done.
    static GRANTED: Cell<usize> = const { Cell::new(usize::MAX) };
    static WATCH: RefCell<Option<Watch>> = const { RefCell::new(None) };
    /// When was asked last.
    static ASKED: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Reports work, in multiplications or so. Unwinds to [`watched`] if the result is not wanted any more.
#[inline]
pub fn checkpoint(work: usize) {
    LEFT.with(|left| match left.get().checked_sub(work) {
        Some(rest) => left.set(rest),
        None => look(work),
    });
}

/// The work that this thread has reported so far, from an arbitrary start: only differences mean something. The same
/// computation makes the same difference, on every machine and whoever watches.
#[inline]
pub fn spent() -> usize {
    GRANTED.get().wrapping_sub(LEFT.get())
}

/// From now on `left` remains until the next look at the clock; returns what remained.
fn grant(left: usize) -> usize {
    GRANTED.set(spent().wrapping_add(left));
    LEFT.replace(left)
}

#[cold]
#[inline(never)]
fn look(work: usize) {
    let watch = WATCH.with_borrow(Clone::clone);
    GRANTED.set(GRANTED.get().wrapping_add(work));
    grant(if watch.is_some() { QUANTUM } else { usize::MAX });
    let Some(watch) = watch else { return };
    if let Watch::Ask(_) = watch {
        let now = Instant::now();
        let asked = ASKED.get().unwrap_or(now);
        if now - asked < EVERY {
            return ASKED.set(Some(asked));
        }
        ASKED.set(Some(now));
    }
    if !watch.is_wanted() {
        panic::resume_unwind(Box::new(Interrupted)); // which does not call the panic hook
    }
}

/// The watch of a thread while a piece of work lasts; then that of before.
struct Scope(Option<Watch>, usize, Option<Instant>);

impl Scope {
    fn enter(watch: Watch) -> Self {
        Self(WATCH.replace(Some(watch)), grant(QUANTUM), ASKED.take())
    }
}

impl Drop for Scope {
    fn drop(&mut self) {
        WATCH.set(self.0.take());
        grant(self.1);
        ASKED.set(self.2);
    }
}

/// The result of `work`, as long as `watch` wants it.
///
/// # Errors
/// If it did not.
pub fn watched<T>(watch: Watch, work: impl FnOnce() -> T) -> Result<T, Interrupted> {
    let scope = Scope::enter(watch);
    let done = panic::catch_unwind(AssertUnwindSafe(work));
    drop(scope);
    done.or_else(|fault| match fault.is::<Interrupted>() {
        true => Err(Interrupted),
        false => panic::resume_unwind(fault),
    })
}

/// Leaves a large value to another thread, which gives its memory back: that takes a while, and an interruption does not
/// wait for it.
pub fn leave<T: Send + 'static>(value: T) {
    // If there is no thread, it is dropped here.
    let _ = thread::Builder::new().spawn(move || drop(value));
}

/// A large value in the making, which is left to another thread where the work is ended.
///
/// # Example
/// ```
/// use vff_core::interrupt::Aside;
///
/// let mut large = Aside::new(Vec::with_capacity(1_000_000));
/// large.as_mut().push(1.0);
/// assert_eq!(large.done(), [1.0]);
/// ```
#[derive(Debug)]
pub struct Aside<T: Default + Send + 'static>(T);

impl<T: Default + Send + 'static> Aside<T> {
    /// What is to be filled in.
    pub fn new(value: T) -> Self {
        Self(value)
    }

    /// The value, when it is made.
    pub fn done(mut self) -> T {
        mem::take(&mut self.0)
    }
}

impl<T: Default + Send + 'static> AsMut<T> for Aside<T> {
    fn as_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

impl<T: Default + Send + 'static> Drop for Aside<T> {
    fn drop(&mut self) {
        if thread::panicking() {
            leave(mem::take(&mut self.0));
        }
    }
}

/// Does work on the threads of `pool`. Its parts are to be done [`within`](Parts::within), so that an interruption of
/// the calling thread, which goes on looking at the clock, ends them, too.
#[cfg(feature = "parallel")]
pub fn on_pool<T: Send>(pool: &ThreadPool, work: impl FnOnce(&Parts) -> T + Send) -> T {
    let Some(watch) = WATCH.with_borrow(Clone::clone) else {
        return pool.install(|| work(&Parts(None)));
    };
    let stop = Arc::new(AtomicBool::new(false));
    let parts = Parts(Some(Watch::Flag(Arc::clone(&stop))));
    let mut result = None;
    pool.in_place_scope(|scope| {
        let (over, is_over) = mpsc::channel::<()>();
        let result = &mut result;
        scope.spawn(move |_| {
            *result = Some(work(&parts));
            drop(over);
        });
        while is_over.recv_timeout(EVERY) == Err(mpsc::RecvTimeoutError::Timeout) {
            if !watch.is_wanted() {
                stop.store(true, Ordering::Relaxed);
            }
        }
    });
    result.expect("the scope waits for it, and unwinds if it was interrupted")
}

/// How the parts of a work on several threads learn that it is not wanted any more.
#[cfg(feature = "parallel")]
#[derive(Debug)]
pub struct Parts(Option<Watch>);

#[cfg(feature = "parallel")]
impl Parts {
    /// Does one part on the present thread.
    pub fn within<T>(&self, part: impl FnOnce() -> T) -> T {
        let Some(watch) = &self.0 else { return part() };
        let _scope = Scope::enter(watch.clone());
        if !watch.is_wanted() {
            panic::resume_unwind(Box::new(Interrupted));
        }
        part()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    #[cfg(feature = "parallel")]
    use rayon::prelude::*;

    fn endless() -> u64 {
        let mut sum = 0_u64;
        loop {
            sum = sum.wrapping_mul(3).wrapping_add(1);
            checkpoint(1);
            if sum == 7 {
                return sum;
            }
        }
    }

    /// The sum of four parts on two threads.
    #[cfg(feature = "parallel")]
    fn in_parts(part: fn() -> u64) -> u64 {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        on_pool(&pool, |parts| (0..4).into_par_iter().map(|_| parts.within(part)).sum())
    }

    /// An endless loop ends when the answer is no, on the present thread and on others.
    #[test]
    fn endless_loops_end() {
        assert_eq!(watched(Watch::Ask(|| false), endless), Err(Interrupted));
        let flag = Arc::new(AtomicBool::new(true));
        assert_eq!(watched(Watch::Flag(flag), endless), Err(Interrupted));
        #[cfg(feature = "parallel")]
        assert_eq!(watched(Watch::Ask(|| false), || in_parts(endless)), Err(Interrupted));
    }

    /// Where the work is ended, what it was to fill is dropped by another thread; where it comes to its end, it is kept.
    #[test]
    fn what_was_in_the_making_is_dropped_elsewhere() {
        #[derive(Default)]
        struct Large(Option<mpsc::Sender<thread::ThreadId>>);
        impl Drop for Large {
            fn drop(&mut self) {
                if let Some(send) = &self.0 {
                    let _ = send.send(thread::current().id());
                }
            }
        }
        let (send, dropped) = mpsc::channel();
        let large = Large(Some(send.clone()));
        let ended = watched(Watch::Ask(|| false), move || {
            let aside = Aside::new(large);
            endless();
            drop(aside.done());
        });
        assert_eq!(ended, Err(Interrupted));
        assert_ne!(dropped.recv().unwrap(), thread::current().id());
        let kept = Aside::new(Large(Some(send))).done();
        assert!(dropped.try_recv().is_err());
        drop(kept);
        assert_eq!(dropped.recv().unwrap(), thread::current().id());
    }

    /// What is wanted comes to its end, also in parts, within another watch, and without any.
    #[test]
    fn what_is_wanted_is_done() {
        fn work() -> u64 {
            (0..10_000_000).for_each(|_| checkpoint(1));
            5
        }
        assert_eq!(work(), 5);
        assert_eq!(watched(Watch::Ask(|| true), work), Ok(5));
        let inner = || (watched(Watch::Ask(|| false), endless), work());
        assert_eq!(watched(Watch::Ask(|| true), inner), Ok((Err(Interrupted), 5)));
        #[cfg(feature = "parallel")]
        {
            let sum = || in_parts(work);
            assert_eq!((sum(), watched(Watch::Ask(|| true), sum)), (20, Ok(20)));
        }
    }

    /// What was done is counted to the unit, under a watch and without, beyond many looks at the clock, and after one that
    /// ended it.
    #[test]
    fn work_is_counted() {
        fn counted(work: impl FnOnce()) -> usize {
            let before = spent();
            work();
            spent().wrapping_sub(before)
        }
        let some = || (0..700).for_each(|k| checkpoint(k * 13));
        let most = 13 * 700 * 699 / 2;
        assert!(most > 3 * QUANTUM);
        assert_eq!(counted(some), most);
        assert_eq!(counted(|| assert!(watched(Watch::Ask(|| true), some).is_ok())), most);
        let inner = || {
            some();
            assert_eq!(counted(|| assert!(watched(Watch::Ask(|| true), some).is_ok())), most);
            some();
        };
        assert_eq!(counted(|| assert!(watched(Watch::Ask(|| true), inner).is_ok())), 3 * most);
        assert_eq!(
            watched(Watch::Flag(Arc::new(AtomicBool::new(true))), endless),
            Err(Interrupted)
        );
        assert_eq!(counted(some), most);
    }

    /// A panic that is none of ours stays one.
    #[test]
    #[should_panic(expected = "a fault")]
    fn panics_are_left_alone() {
        let _ = watched(Watch::Ask(|| true), || panic!("a fault"));
    }
}
