import threading

from consolefake import picture

from anaplot.console.commands import CommandThread
from anaplot.console.mailbox import Mailbox
from anaplot.errors import InputError, LinkError
from anaplot.exchange.recordline import JournalError


def test_a_thousand_snapshots_wake_once_and_the_newest_is_shown():
    woken = []
    mailbox = Mailbox(lambda: woken.append(1))
    snapshot = picture()
    for serial in range(1000):
        mailbox.put_snapshot(picture(serial=serial) if serial in (0, 999) else snapshot)
    assert len(woken) == 1
    taken, notices = mailbox.take()
    assert taken.serial == 999
    assert notices == []
    assert mailbox.take() == (None, [])
    mailbox.put_notice("info", "again")
    assert len(woken) == 2


def test_an_older_snapshot_does_not_replace_a_newer_one():
    mailbox = Mailbox(lambda: None)
    mailbox.put_snapshot(picture(serial=7))
    mailbox.put_snapshot(picture(serial=6))
    assert mailbox.take()[0].serial == 7


def test_notices_come_in_order_and_are_bounded():
    mailbox = Mailbox(lambda: None, keep=3)
    for i in range(5):
        mailbox.put_notice("info", str(i))
    assert mailbox.take()[1] == [("info", "2"), ("info", "3"), ("info", "4")]


def test_many_threads_may_bring_something():
    woken = []
    mailbox = Mailbox(lambda: woken.append(threading.get_ident()), keep=10_000)
    snapshots = [picture(serial=i) for i in range(50)]

    def bring():
        for snapshot in snapshots:
            mailbox.put_snapshot(snapshot)
            mailbox.put_notice("info", str(snapshot.serial))

    threads = [threading.Thread(target=bring) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    snapshot, notices = mailbox.take()
    assert len(woken) == 1
    assert snapshot.serial == 49
    assert len(notices) == 200


def test_commands_run_in_order_and_go_on_after_a_fault():
    said, done = [], []
    commands = CommandThread(lambda *told: said.append(told))
    commands.start()

    def lost():
        raise LinkError("the plotter does not answer")

    def untimely():
        raise InputError("drive to a point first")

    def full():
        raise JournalError("the disk is full")

    def broken():
        raise ValueError("a bug")

    commands.submit(lambda: done.append(1))
    commands.submit(lost)
    commands.submit(broken)
    commands.submit(untimely)
    commands.submit(full)
    commands.submit(lambda: done.append(2))
    commands.close(60)
    assert done == [1, 2]
    assert said == [
        ("error", "the plotter does not answer"),
        ("error", "unexpected ValueError: a bug"),
        ("hint", "drive to a point first"),
        ("error", "the disk is full"),
    ]


def test_closing_before_starting_is_harmless():
    CommandThread(lambda severity, text: None).close()
