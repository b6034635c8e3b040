/** The forms in which control is asked for, offered, and kept or handed over: each with a reason. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, type ReactNode, useState } from "react";
import { useLive } from "../live/react";
import { MOST_LETTERS, othersToGetControl, useAnswer, useAsk, useOffer } from "../service/handOver";
import { sessionQuery } from "../service/queries";
import { RefusedFields } from "../service/refusedFields";
import { isText, useDraft } from "../service/useDraft";
import type { State } from "../wire/types";
import { ChoiceField } from "./ChoiceField";
import styles from "./ControlForms.module.css";
import { Refusal } from "./Refusal";
import { TextField } from "./TextField";

const NOBODY: State["people"] = [];
const NO_WISHES: State["wishes"] = [];

interface Done {
  onDone(): void;
}

export function AskForm({ onDone }: Done) {
  const { value: reason, set: setReason, discard } = useDraft("reason to ask for control", "", isText);
  const ask = useAsk();
  const holder = useLive((live) => live.state?.holder?.name);
  return (
    <ReasonForm
      title={`Ask ${holder ?? "nobody"} for control`}
      label="What for?"
      error={ask.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => ask.mutate(reason, { onSuccess: () => discardAndClose(discard, onDone) })}
    >
      <Button type="submit" size="compact-sm" disabled={reason.trim() === ""} loading={ask.isPending}>
        Ask
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

export function OfferForm({ onDone }: Done) {
  const people = useLive((live) => live.state?.people ?? NOBODY);
  const me = useQuery(sessionQuery).data;
  const others = othersToGetControl(people, me?.name);
  const [to, setTo] = useState(others[0] ?? "");
  const { value: reason, set: setReason, discard } = useDraft("reason to offer control", "", isText);
  const offer = useOffer();
  // who was chosen stays so when they leave: to be refused, not to become somebody else
  const choices = others.includes(to) || to === "" ? others : [...others, to];
  return (
    <ReasonForm
      title="Hand control over"
      label="Why?"
      error={offer.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => offer.mutate({ to, reason }, { onSuccess: () => discardAndClose(discard, onDone) })}
      above={<ChoiceField label="To" name="to" size="xs" data={choices} value={to} onChange={setTo} />}
    >
      <Button
        type="submit"
        size="compact-sm"
        disabled={reason.trim() === "" || to === ""}
        loading={offer.isPending}
      >
        Offer control
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

export function AnswerForm({ number, onDone }: Done & { readonly number: number }) {
  const answer = useAnswer();
  const wish = useLive((live) => live.state?.wishes ?? NO_WISHES).find((one) => one.number === number);
  // numbers begin again with the service: the draft belongs to the request itself
  const form = `answer to ${wish?.name ?? ""}: ${wish?.reason ?? ""}`;
  const { value: reason, set: setReason, discard } = useDraft(form, "", isText);
  const isOver = wish?.standing !== "asked";
  const say = (said: "hand_over" | "decline") =>
    answer.mutate({ number, answer: said, reason }, { onSuccess: () => discardAndClose(discard, onDone) });
  return (
    <ReasonForm
      title={isOver ? "This request is over" : `${wish.name} asks for control: “${wish.reason}”`}
      label="Say something to that (needed to keep control)"
      error={answer.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => undefined}
    >
      <Button size="compact-sm" disabled={isOver} loading={answer.isPending} onClick={() => say("hand_over")}>
        Hand over
      </Button>
      <Button
        size="compact-sm"
        variant="default"
        disabled={isOver || answer.isPending || reason.trim() === ""}
        onClick={() => say("decline")}
      >
        Keep control
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

/** Discard the draft of a reason that was sent, and close its form. */
function discardAndClose(discard: () => void, onDone: () => void): void {
  discard();
  onDone();
}

function Close({ onDone }: Done) {
  return (
    <Button size="compact-sm" variant="subtle" color="gray" onClick={onDone}>
      Close
    </Button>
  );
}

interface ReasonFormProps {
  readonly title: string;
  readonly label: string;
  readonly error: Error | null;
  readonly reason: string;
  readonly above?: ReactNode;
  readonly children: ReactNode;
  onReason(reason: string): void;
  onSubmit(): void;
}

function ReasonForm({ title, label, error, reason, above, children, onReason, onSubmit }: ReasonFormProps) {
  function submit(event: FormEvent): void {
    event.preventDefault();
    onSubmit();
  }
  return (
    <RefusedFields error={error} about={reason} only="reason">
      <form className={styles.form} aria-label={title} onSubmit={submit}>
        <p className={styles.title}>{title}</p>
        {above}
        <TextField
          name="reason"
          label={label}
          size="xs"
          data-autofocus
          maxLength={MOST_LETTERS}
          value={reason}
          onChange={onReason}
        />
        <div className={styles.buttons}>{children}</div>
        <Refusal error={error} about={reason} />
      </form>
    </RefusedFields>
  );
}
