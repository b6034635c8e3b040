import { Button, Menu, Popover } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { type FormEvent, type ReactNode, useEffect, useRef, useState, useSyncExternalStore } from "react";
import { TbAlertTriangle, TbDeviceGamepad2, TbHandStop } from "react-icons/tb";
import { useLive } from "../live/react";
import { timeOfDay } from "../samples/format";
import { countThings, fillText } from "../samples/texts";
import { sessionQuery, useSignOut } from "../service/api/session";
import { describeLoss, NO_CONTROL, nextControlState, useMayCommand } from "../service/control/control";
import {
  type ControlForm,
  isOpen,
  isRequested,
  isRequestOfThisPage,
  MOST_LETTERS,
  type Notice,
  type NoticeAction,
  noticeOf,
  othersToGetControl,
  useAnswerRequest,
  useOfferControl,
  useRequestControl,
  useTakeHandedControl,
} from "../service/control/handover";
import { isText, useDraft } from "../service/forms/drafts";
import { RefusedFields, useErrorLifetime } from "../service/forms/refusals";
import { answeredBy } from "../wire/client";
import { givenUpEpoch, giveUpControl, heldEpoch, takeControl, watchHeld } from "../wire/control";
import type { State } from "../wire/types";
import controlFormsStyles from "./ControlForms.module.css";
import controlLossStyles from "./ControlLoss.module.css";
import controlMenuStyles from "./ControlMenu.module.css";
import { ChoiceField, TextField } from "./fields";
import handOverStyles from "./HandOver.module.css";
import { Refusal, TakeControl } from "./Refusal";
import { TEXTS } from "./texts";

/** Forms of the handover: request, offer and reply, each with a reason. */

const NOBODY: State["people"] = [];
const NO_WISHES: State["wishes"] = [];

interface Done {
  onDone(): void;
}

function AskForm({ onDone }: Done) {
  const { value: reason, set: setReason, discard } = useDraft("reason to ask for control", "", isText);
  const ask = useRequestControl();
  const holder = useLive((live) => live.state?.holder?.name);
  return (
    <ReasonForm
      title={fillText(TEXTS.askForControl, { name: holder ?? TEXTS.nobody })}
      label={TEXTS.reason}
      error={ask.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => ask.mutate(reason, { onSuccess: () => discardAndClose(discard, onDone) })}
    >
      <Button type="submit" size="compact-sm" disabled={reason.trim() === ""} loading={ask.isPending}>
        {TEXTS.ask}
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

function OfferForm({ onDone }: Done) {
  const people = useLive((live) => live.state?.people ?? NOBODY);
  const me = useQuery(sessionQuery).data;
  const others = othersToGetControl(people, me?.name);
  const [to, setTo] = useState(others[0] ?? "");
  const { value: reason, set: setReason, discard } = useDraft("reason to offer control", "", isText);
  const offer = useOfferControl();
  // A chosen person remains chosen after leaving: the service then refuses, and no other person is offered control.
  const choices = others.includes(to) || to === "" ? others : [...others, to];
  return (
    <ReasonForm
      title={TEXTS.handControlOver}
      label={TEXTS.reason}
      error={offer.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => offer.mutate({ to, reason }, { onSuccess: () => discardAndClose(discard, onDone) })}
      above={
        <ChoiceField
          label={TEXTS.handOverTo}
          name="to"
          size="xs"
          data={choices}
          value={to}
          onChange={setTo}
        />
      }
    >
      <Button
        type="submit"
        size="compact-sm"
        disabled={reason.trim() === "" || to === ""}
        loading={offer.isPending}
      >
        {TEXTS.offerControl}
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

function AnswerForm({ number, onDone }: Done & { readonly number: number }) {
  const answer = useAnswerRequest();
  const wish = useLive((live) => live.state?.wishes ?? NO_WISHES).find((one) => one.number === number);
  // Numbers restart with the service, so the draft belongs to the content of the request.
  const form = `answer to ${wish?.name ?? ""}: ${wish?.reason ?? ""}`;
  const { value: reason, set: setReason, discard } = useDraft(form, "", isText);
  const isOver = wish?.standing !== "asked";
  const reply = (decision: "hand_over" | "decline") =>
    answer.mutate(
      { number, answer: decision, reason },
      { onSuccess: () => discardAndClose(discard, onDone) },
    );
  return (
    <ReasonForm
      title={
        isOver ? TEXTS.requestEnded : fillText(TEXTS.requestOf, { name: wish.name, reason: wish.reason })
      }
      label={TEXTS.reply}
      error={answer.error}
      reason={reason}
      onReason={setReason}
      onSubmit={() => undefined}
    >
      <Button
        size="compact-sm"
        disabled={isOver}
        loading={answer.isPending}
        onClick={() => reply("hand_over")}
      >
        {TEXTS.handOver}
      </Button>
      <Button
        size="compact-sm"
        variant="default"
        disabled={isOver || answer.isPending || reason.trim() === ""}
        onClick={() => reply("decline")}
      >
        {TEXTS.keepControl}
      </Button>
      <Close onDone={onDone} />
    </ReasonForm>
  );
}

/** Discards the draft of a sent reason, and closes its form. */
function discardAndClose(discard: () => void, onDone: () => void): void {
  discard();
  onDone();
}

function Close({ onDone }: Done) {
  return (
    <Button size="compact-sm" variant="subtle" color="gray" onClick={onDone}>
      {TEXTS.close}
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
      <form className={controlFormsStyles.form} aria-label={title} onSubmit={submit}>
        <p className={controlFormsStyles.title}>{title}</p>
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
        <div className={controlFormsStyles.buttons}>{children}</div>
        <Refusal error={error} about={reason} />
      </form>
    </RefusedFields>
  );
}

/** Requests and offers of control in the status line, with the buttons of a reply. */

const WORDS: Record<NoticeAction, string> = {
  answer: TEXTS.answer,
  withdraw: TEXTS.withdraw,
  take: TEXTS.takeControl,
  decline: TEXTS.decline,
  read: TEXTS.read,
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
          <span className={handOverStyles.anchor} aria-hidden="true" />
        </Popover.Target>
        <Popover.Dropdown p="sm" aria-label={TEXTS.control}>
          {form?.kind === "ask" && <AskForm onDone={() => onForm(null)} />}
          {form?.kind === "offer" && <OfferForm onDone={() => onForm(null)} />}
          {form?.kind === "answer" && <AnswerForm number={form.number} onDone={() => onForm(null)} />}
        </Popover.Dropdown>
      </Popover>
    </>
  );
}

/** The most urgent notice and the number of other urgent ones; a read notice does not return. */
function useNotice() {
  const wishes = useLive((live) => live.state?.wishes ?? NO_WISHES);
  const holder = useLive((live) => live.state?.holder?.epoch ?? null);
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const me = useQuery(sessionQuery).data;
  const [read, setRead] = useState<ReadonlySet<string>>(new Set());
  // The end of a request that was over before the page loaded is not shown.
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
  const answer = useAnswerRequest();
  const take = useTakeHandedControl();
  const { wish, text, actions, urgent } = notice;
  const refusal = useErrorLifetime(answer.error ?? take.error)?.message;
  const takes = wish.standing === "handed" && actions.includes("take") && isRequestOfThisPage(wish);
  const taken = useRef<number | null>(null);
  const { mutate: takeNow } = take;
  useEffect(() => {
    // This page requested control: it takes it without another question.
    if (!takes || taken.current === wish.number) return;
    taken.current = wish.number;
    takeNow(wish.number);
  }, [takes, takeNow, wish.number]);

  function act(action: NoticeAction): void {
    if (action === "answer") onForm({ kind: "answer", number: wish.number });
    if (action === "take") take.mutate(wish.number);
    if (action === "read") onRead(notice);
    if (action === "withdraw" || action === "decline")
      answer.mutate({ number: wish.number, answer: "decline" });
  }

  return (
    <section className={handOverStyles.notice} data-wish={wish.standing} aria-label={TEXTS.controlRequest}>
      <TbHandStop size={16} aria-hidden="true" className={handOverStyles.icon} />
      <NoticeMessage text={refusal ?? text} urgent={urgent} />
      {more > 0 && <span className={handOverStyles.more}>+{more}</span>}
      {actions.map((action) => (
        <Button
          key={action}
          size="compact-xs"
          variant={action === "answer" || action === "take" ? "filled" : "default"}
          loading={(action === "take" && take.isPending) || (action === "withdraw" && answer.isPending)}
          onClick={() => act(action)}
        >
          {WORDS[action]}
        </Button>
      ))}
    </section>
  );
}

function NoticeMessage({ text, urgent }: { text: string; urgent: boolean }) {
  if (!urgent) {
    return (
      <output className={handOverStyles.text} title={text}>
        {text}
      </output>
    );
  }
  return (
    <span role="alert" className={handOverStyles.text} title={text}>
      {text}
    </span>
  );
}

/** Shows that this page has lost control, until it has control again or a person closes the message. */

export function ControlLoss() {
  const state = useLive((live) => live.state);
  const [control, setControl] = useState(NO_CONTROL);
  useEffect(() => {
    if (state === null) return;
    const handed = state.wishes.some(({ epoch }) => epoch !== null && epoch === state.holder?.epoch);
    setControl((before) => {
      const givenUp = handed ? before.had : givenUpEpoch();
      return nextControlState(before, state.holder, heldEpoch(), givenUp, Date.now());
    });
  }, [state]);
  if (control.lost === null) return null;
  const at = new Date(control.lost.at_ms).toLocaleTimeString("sv-SE");
  return (
    <div className={controlLossStyles.loss} role="alert" aria-label={TEXTS.controlLost}>
      <TbAlertTriangle size={18} aria-hidden="true" />
      <span className={controlLossStyles.message}>
        <strong>{at}</strong> {describeLoss(control.lost)}
      </span>
      <TakeControl variant="white" color="dark" />
      <Button size="compact-xs" variant="subtle" color="dark" onClick={() => setControl(NO_CONTROL)}>
        {TEXTS.keepObserving}
      </Button>
    </div>
  );
}

/** Content for operators only; viewers do not see it. */

export function OperatorsOnly({
  children,
  otherwise = null,
}: {
  children: ReactNode;
  otherwise?: ReactNode;
}) {
  return useMayCommand() === false ? otherwise : children;
}

/** Menu of control: its holder, taking it, connected people, the person's name, and signing out. */

interface ControlMenuProps {
  onName(): void;
  onForm(form: ControlForm): void;
}

export function ControlMenu({ onName, onForm }: ControlMenuProps) {
  const holder = useLive((live) => live.state?.holder ?? null);
  const take = useMutation({ mutationFn: (takeOver: boolean) => answeredBy(takeControl(takeOver)) });
  const giveUp = useMutation({ mutationFn: () => answeredBy(giveUpControl()) });
  const people = useLive((live) => live.state?.people ?? NOBODY);
  const me = useQuery(sessionQuery).data;
  const signOut = useSignOut();
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const mine = holder !== null && holder.epoch === epoch;
  const name = holder === null ? TEXTS.nobody : mine ? TEXTS.you : holder.name;
  const asking = useLive((live) => live.state?.wishes ?? NO_WISHES).filter(isRequested);
  const others = othersToGetControl(people, me?.name);
  const refusal = useErrorLifetime(take.error ?? giveUp.error ?? signOut.error)?.message;
  return (
    <Menu position="bottom-end" width={300} withInitialFocusPlaceholder={false}>
      <Menu.Target>
        <Button
          size="compact-sm"
          variant={mine ? "light" : "subtle"}
          color={mine ? undefined : "gray"}
          leftSection={<TbDeviceGamepad2 size={16} aria-hidden="true" />}
          title={refusal ?? fillText(holder?.lost ? TEXTS.controlTitleLost : TEXTS.controlTitle, { name })}
          aria-label={fillText(TEXTS.controlOf, { name })}
          styles={{ label: { maxWidth: "10ch", minWidth: "7ch" } }}
        >
          {name}
        </Button>
      </Menu.Target>
      <Menu.Dropdown>
        <OperatorsOnly>
          {mine ? (
            <>
              {asking.map(({ number, name }) => (
                <Menu.Item key={number} onClick={() => onForm({ kind: "answer", number })}>
                  {fillText(TEXTS.answerItem, { name })}
                </Menu.Item>
              ))}
              {others.length > 0 && (
                <Menu.Item onClick={() => onForm({ kind: "offer" })}>{TEXTS.handOverItem}</Menu.Item>
              )}
              <Menu.Item onClick={() => giveUp.mutate()}>{TEXTS.giveUpControl}</Menu.Item>
            </>
          ) : (
            <>
              {holder?.page && holder.name !== me?.name && !asking.some((one) => one.name === me?.name) && (
                <Menu.Item onClick={() => onForm({ kind: "ask" })}>
                  {fillText(TEXTS.askItem, { name: holder.name })}
                </Menu.Item>
              )}
              <Menu.Item onClick={() => take.mutate(holder !== null)}>
                {holder === null ? TEXTS.takeControl : fillText(TEXTS.takeOver, { name: holder.name })}
              </Menu.Item>
            </>
          )}
        </OperatorsOnly>
        <Menu.Label>{TEXTS.anyoneStops}</Menu.Label>
        <Menu.Divider />
        <Menu.Label>{TEXTS.connected}</Menu.Label>
        {/* biome-ignore lint/a11y/useSemanticElements: a menu holds items only; these can be read and do nothing */}
        <div role="group" className={controlMenuStyles.people} aria-label={TEXTS.connected}>
          {people.map((person) => (
            <div role="menuitem" aria-disabled tabIndex={-1} key={`${person.name} ${person.role}`}>
              <span>
                {person.name === me?.name ? fillText(TEXTS.personYou, { name: person.name }) : person.name}
              </span>
              <span className={controlMenuStyles.what}>
                {describePerson(person, holder?.name ?? null)}{" "}
                <span className={controlMenuStyles.since}>
                  {fillText(TEXTS.since, { time: timeOfDay(person.since) })}
                </span>
              </span>
            </div>
          ))}
        </div>
        <Menu.Divider />
        <Menu.Item onClick={onName}>{TEXTS.changeName}</Menu.Item>
        <Menu.Item onClick={() => signOut.mutate()}>{TEXTS.signOut}</Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}

/** Rights and state of a connected person. */
function describePerson({ name, role, pages }: State["people"][number], holder: string | null): string {
  const right =
    role === "viewer" ? TEXTS.viewOnly : name === holder ? TEXTS.hasControl : TEXTS.canTakeControl;
  return fillText(TEXTS.personState, { right, pages: countThings(pages, "page") });
}
