/** Who asks for control, or offers it, in the status line, where nothing moves for it; and what is said to that. */

import { Button, Popover } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useRef, useState, useSyncExternalStore } from "react";
import { TbHandStop } from "react-icons/tb";
import { useLive } from "../live/react";
import {
  askedHere,
  type ControlForm,
  type Deed,
  isOpen,
  type Notice,
  noticeOf,
  useAnswer,
  useTakeHanded,
} from "../service/handOver";
import { sessionQuery } from "../service/queries";
import { useErrorLifetime } from "../service/useErrorLifetime";
import { heldEpoch, watchHeld } from "../wire/control";
import type { State } from "../wire/types";
import { AnswerForm, AskForm, OfferForm } from "./ControlForms";
import styles from "./HandOver.module.css";

const NO_WISHES: State["wishes"] = [];
const WORDS: Record<Deed, string> = {
  answer: "Answer …",
  withdraw: "Withdraw",
  take: "Take control",
  decline: "Decline",
  read: "OK",
};

interface HandOverProps {
  readonly form: ControlForm | null;
  onForm(form: ControlForm | null): void;
}

export function HandOver({ form, onForm }: HandOverProps) {
  const notice = useNotice();
  return (
    <>
      {notice.shown !== null && (
        <NoticeLine notice={notice.shown} more={notice.more} onRead={notice.read} onForm={onForm} />
      )}
      <Popover
        opened={form !== null}
        onChange={(opened) => opened || onForm(null)}
        position="bottom-end"
        width={340}
        shadow="md"
        trapFocus
        returnFocus
        closeOnClickOutside={false}
      >
        <Popover.Target>
          <span className={styles.anchor} aria-hidden="true" />
        </Popover.Target>
        <Popover.Dropdown p="sm" aria-label="Control">
          {form?.kind === "ask" && <AskForm onDone={() => onForm(null)} />}
          {form?.kind === "offer" && <OfferForm onDone={() => onForm(null)} />}
          {form?.kind === "answer" && <AnswerForm number={form.number} onDone={() => onForm(null)} />}
        </Popover.Dropdown>
      </Popover>
    </>
  );
}

/** The notice that wants most of its reader, and how many more want something; what was read is gone for good. */
function useNotice() {
  const wishes = useLive((live) => live.state?.wishes ?? NO_WISHES);
  const holder = useLive((live) => live.state?.holder?.epoch ?? null);
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const me = useQuery(sessionQuery).data;
  const [read, setRead] = useState<ReadonlySet<string>>(new Set());
  // the end of what was over before this page was loaded is no news
  const seen = useRef(new Set<number>());
  const holds = holder !== null && holder === epoch;
  const notices = wishes
    .map((wish) => (me?.role === "operator" ? noticeOf(wish, me.name, holds) : null))
    .filter((notice) => notice !== null)
    .filter(
      (notice) => !read.has(keyOf(notice)) && (isOpen(notice.wish) || seen.current.has(notice.wish.number)),
    );
  useEffect(() => {
    for (const wish of wishes.filter(isOpen)) seen.current.add(wish.number);
  }, [wishes]);
  return {
    shown: notices.find(({ urgent }) => urgent) ?? notices.at(-1) ?? null,
    more: notices.filter(({ urgent }) => urgent).length - 1,
    read: (notice: Notice) => setRead(new Set([...read, keyOf(notice)])),
  };
}

function keyOf({ wish }: Notice): string {
  return `${wish.number} ${wish.standing}`;
}

interface NoticeLineProps {
  readonly notice: Notice;
  readonly more: number;
  onRead(notice: Notice): void;
  onForm(form: ControlForm): void;
}

function NoticeLine({ notice, more, onRead, onForm }: NoticeLineProps) {
  const answer = useAnswer();
  const take = useTakeHanded();
  const { wish, text, deeds, urgent } = notice;
  const refusal = useErrorLifetime(answer.error ?? take.error)?.message;
  const takes = wish.standing === "handed" && deeds.includes("take") && askedHere(wish);
  const taken = useRef<number | null>(null);
  const { mutate: takeNow } = take;
  useEffect(() => {
    // asked for at this page: nobody is asked once more
    if (!takes || taken.current === wish.number) return;
    taken.current = wish.number;
    takeNow(wish.number);
  }, [takes, takeNow, wish.number]);

  function act(deed: Deed): void {
    if (deed === "answer") onForm({ kind: "answer", number: wish.number });
    if (deed === "take") take.mutate(wish.number);
    if (deed === "read") onRead(notice);
    if (deed === "withdraw" || deed === "decline") answer.mutate({ number: wish.number, answer: "decline" });
  }

  return (
    <section className={styles.notice} data-wish={wish.standing} aria-label="Control asked for">
      <TbHandStop size={16} aria-hidden="true" className={styles.icon} />
      <Said text={refusal ?? text} urgent={urgent} />
      {more > 0 && <span className={styles.more}>+{more}</span>}
      {deeds.map((deed) => (
        <Button
          key={deed}
          size="compact-xs"
          variant={deed === "answer" || deed === "take" ? "filled" : "default"}
          loading={(deed === "take" && take.isPending) || (deed === "withdraw" && answer.isPending)}
          onClick={() => act(deed)}
        >
          {WORDS[deed]}
        </Button>
      ))}
    </section>
  );
}

function Said({ text, urgent }: { text: string; urgent: boolean }) {
  if (!urgent) {
    return (
      <output className={styles.text} title={text}>
        {text}
      </output>
    );
  }
  return (
    <span role="alert" className={styles.text} title={text}>
      {text}
    </span>
  );
}
