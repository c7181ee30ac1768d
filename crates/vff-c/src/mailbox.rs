//! One value handed from one thread to another without a lock.
//!
//! The sender allocates and frees, the receiver does neither: it exchanges what it has for what was sent, and leaves the old value
//! for the sender to collect. If nobody has taken the last value, a new one takes its place.
//!
//! Nothing here depends on the rest of the crate, so that `tests/thread_sanitizer.rs` compiles it alone.

use std::fmt;
use std::ptr;
use std::sync::atomic::{
    AtomicBool, AtomicPtr,
    Ordering::{AcqRel, Acquire, Relaxed, Release},
};

/// Where a value waits for its receiver.
pub struct Mailbox<T> {
    /// What was sent and not taken.
    sent: AtomicPtr<Node<T>>,
    /// What the receiver had before: a list that it adds to, and that a sender takes as a whole.
    returned: AtomicPtr<Node<T>>,
    closed: AtomicBool,
}

struct Node<T> {
    value: T,
    next: *mut Self,
}

// SAFETY: it hands values from thread to thread, and shares none between two.
unsafe impl<T: Send> Send for Mailbox<T> {}
// SAFETY: as above; whoever swaps a pointer out owns what it points to.
unsafe impl<T: Send> Sync for Mailbox<T> {}

impl<T> Mailbox<T> {
    /// Nothing was sent.
    pub fn new() -> Self {
        let [sent, returned] = [(); 2].map(|()| AtomicPtr::new(ptr::null_mut()));
        Self { sent, returned, closed: AtomicBool::new(false) }
    }

    /// Sends a value, and frees those that came back. Any thread may, at any time.
    pub fn send(&self, value: T) {
        self.collect();
        let node = Box::into_raw(Box::new(Node { value, next: ptr::null_mut() }));
        let unread = self.sent.swap(node, AcqRel);
        if !unread.is_null() {
            // SAFETY: it came from `Box::into_raw`, and whoever swaps it out owns it.
            drop(unsafe { Box::from_raw(unread) });
        }
    }

    /// If a value was sent, lets `exchange` swap it for the old one. Does not wait, allocate or free. One thread at a time may.
    pub fn receive(&self, exchange: impl FnOnce(&mut T)) -> bool {
        if self.sent.load(Relaxed).is_null() {
            return false;
        }
        let node = self.sent.swap(ptr::null_mut(), AcqRel);
        if node.is_null() {
            return false;
        }
        // SAFETY: it came from `Box::into_raw`, and whoever swaps it out owns it.
        exchange(unsafe { &mut (*node).value });
        let mut head = self.returned.load(Relaxed);
        loop {
            // SAFETY: nobody else knows of the node until the exchange below succeeds.
            unsafe { (*node).next = head };
            // It fails only where a sender has just taken the list, which is empty then.
            match self.returned.compare_exchange_weak(head, node, Release, Relaxed) {
                Ok(_) => return true,
                Err(now) => head = now,
            }
        }
    }

    /// Frees the values that came back. Any thread may, at any time.
    pub fn collect(&self) {
        let mut node = self.returned.swap(ptr::null_mut(), Acquire);
        while !node.is_null() {
            // SAFETY: it came from `Box::into_raw`, and whoever swaps the list out owns all of it.
            node = unsafe { Box::from_raw(node) }.next;
        }
    }

    /// Says that nobody will receive anything any more.
    pub fn close(&self) {
        self.closed.store(true, Relaxed);
    }

    /// Whether nobody will.
    pub fn is_closed(&self) -> bool {
        self.closed.load(Relaxed)
    }
}

impl<T> fmt::Debug for Mailbox<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Mailbox").finish_non_exhaustive()
    }
}

impl<T> Drop for Mailbox<T> {
    fn drop(&mut self) {
        self.collect();
        let unread = *self.sent.get_mut();
        if !unread.is_null() {
            // SAFETY: it came from `Box::into_raw`, and nobody else is left.
            drop(unsafe { Box::from_raw(unread) });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;
    use std::thread;

    /// Three equal numbers, unless somebody writes while another reads. Counts those that live.
    struct Value([u64; 3], Arc<AtomicUsize>);

    impl Value {
        fn new(number: u64, living: &Arc<AtomicUsize>) -> Self {
            living.fetch_add(1, Relaxed);
            Self([number; 3], Arc::clone(living))
        }
    }

    impl Drop for Value {
        fn drop(&mut self) {
            self.1.fetch_sub(1, Relaxed);
        }
    }

    /// Two senders, one receiver: values arrive whole, none twice, those of each sender in order, the last one in
    /// any case; and all are freed in the end.
    #[test]
    fn what_is_sent_arrives_whole() {
        const EACH: u64 = 20_000;
        let living = Arc::new(AtomicUsize::new(0));
        let mailbox = Arc::new(Mailbox::new());
        let sent = Arc::new(AtomicUsize::new(0));
        let senders = [0, 1].map(|sender| {
            let (mailbox, living, sent) = (mailbox.clone(), living.clone(), sent.clone());
            thread::spawn(move || {
                for k in 1..=EACH {
                    mailbox.send(Value::new(2 * k + sender, &living));
                    // So that there is something to receive between two, on one core, too.
                    if k % 16 == 0 {
                        thread::yield_now();
                    }
                }
                sent.fetch_add(1, Release);
            })
        });
        let mut current = Value::new(0, &living);
        let mut last = [0; 2];
        let mut received = 0;
        loop {
            let over = sent.load(Acquire) == 2;
            let came = mailbox.receive(|value| std::mem::swap(&mut current, value));
            if came {
                let [a, b, c] = current.0;
                assert!(a == b && b == c, "torn: {a}, {b}, {c}");
                let sender = (a % 2) as usize;
                assert!(a > last[sender], "{a} after {}", last[sender]);
                last[sender] = a;
                received += 1;
            } else if over {
                break;
            } else {
                thread::yield_now();
            }
        }
        senders.into_iter().for_each(|sender| sender.join().unwrap());
        assert!(received > 1 && last.iter().any(|last| last / 2 == EACH), "{received}, {last:?}");
        drop(current);
        assert!(!mailbox.is_closed());
        drop(mailbox);
        assert_eq!(living.load(Relaxed), 0);
    }

    /// What nobody took is replaced, and freed with the mailbox.
    #[test]
    fn unread_values_are_freed() {
        let living = Arc::new(AtomicUsize::new(0));
        let mailbox = Mailbox::new();
        assert!(!mailbox.receive(|_| panic!("nothing was sent")));
        mailbox.send(Value::new(1, &living));
        mailbox.send(Value::new(2, &living));
        assert_eq!(living.load(Relaxed), 1);
        let mut current = Value::new(0, &living);
        assert!(mailbox.receive(|value| std::mem::swap(&mut current, value)));
        assert_eq!((current.0[0], living.load(Relaxed)), (2, 2), "the old one waits");
        mailbox.collect();
        assert_eq!(living.load(Relaxed), 1);
        mailbox.send(Value::new(3, &living));
        mailbox.close();
        assert!(mailbox.is_closed());
        drop(mailbox);
        assert_eq!(living.load(Relaxed), 1);
    }
}
