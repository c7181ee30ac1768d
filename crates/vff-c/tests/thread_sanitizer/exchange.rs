//! Two senders and a receiver, for the thread sanitizer. Threads are those of the system: the sanitizer does not see how the
//! standard library, which is not instrumented, ends its own.

mod mailbox;

use mailbox::Mailbox;
use std::ffi::c_void;
use std::ptr;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread::yield_now;

const EACH: u64 = 20_000;

struct Shared {
    mailbox: Mailbox<Vec<u64>>,
    over: AtomicUsize,
}

unsafe extern "C" {
    fn pthread_create(
        thread: *mut usize,
        attributes: *const c_void,
        run: extern "C" fn(*mut c_void) -> *mut c_void,
        argument: *mut c_void,
    ) -> i32;
    fn pthread_join(thread: usize, result: *mut *mut c_void) -> i32;
}

extern "C" fn send(shared: *mut c_void) -> *mut c_void {
    // SAFETY: it lives as long as the threads.
    let shared = unsafe { &*shared.cast::<Shared>() };
    for k in 1..=EACH {
        shared.mailbox.send(vec![k; 3]);
        if k % 16 == 0 {
            yield_now();
        }
    }
    shared.over.fetch_add(1, Relaxed);
    ptr::null_mut()
}

fn main() {
    let shared = Shared { mailbox: Mailbox::new(), over: AtomicUsize::new(0) };
    let argument = (&raw const shared).cast_mut().cast();
    let threads = [(); 2].map(|()| {
        let mut thread = 0;
        // SAFETY: what is shared outlives both, as they are joined below.
        assert_eq!(unsafe { pthread_create(&raw mut thread, ptr::null(), send, argument) }, 0);
        thread
    });
    let mut current = vec![0; 3];
    let mut received = 0;
    loop {
        // Relaxed: that the values are seen whole is up to the mailbox.
        let last = shared.over.load(Relaxed) == 2;
        if shared.mailbox.receive(|value| std::mem::swap(value, &mut current)) {
            assert!(current.iter().all(|x| *x == current[0]), "torn: {current:?}");
            received += 1;
        } else if last {
            break;
        } else {
            yield_now();
        }
    }
    for thread in threads {
        // SAFETY: it runs, and is joined once.
        assert_eq!(unsafe { pthread_join(thread, ptr::null_mut()) }, 0);
    }
    assert!(received > 1);
    shared.mailbox.close();
    assert!(shared.mailbox.is_closed());
}
