import { useMutation, useQuery } from "@tanstack/react-query";
import { useState, useSyncExternalStore } from "react";
import { useLive } from "../live/react";
import type { Live } from "../live/store";
import { answeredBy, RequestError } from "../wire/client";
import { heldEpoch, sayOfControl, takeHanded, watchHeld } from "../wire/control";
import type { State, Wish } from "../wire/types";
import { sessionQuery } from "./queries";
import { whyNoRetuning } from "./tuning";

/** Whether this page has lost control that it had. Pure. */

type Holder = State["holder"];

/** What this page knows of its control; `lost` stays until control is had again or a person has read it. */
export interface ControlKept {
  /** Control that the service has told this page to have. */
  readonly had: number | null;
  readonly lost: { readonly to: string | null; readonly at_ms: number } | null;
}

export const NO_CONTROL: ControlKept = { had: null, lost: null };

/** The service has told who holds control; `mine` is what this page holds, `givenUp` what it gave up itself. */
export function afterTold(
  before: ControlKept,
  holder: Holder,
  mine: number | null,
  givenUp: number | null,
  now_ms: number,
): ControlKept {
  if (holder !== null && holder.epoch === mine)
    return before.had === mine && before.lost === null ? before : { had: mine, lost: null };
  if (before.had === null) return before;
  // the state of before a reload, or one that was on its way: this page holds a newer control by now
  if (mine !== null && mine > before.had) return before;
  if (before.had === givenUp) return { ...before, had: null };
  return { had: null, lost: { to: holder?.name ?? null, at_ms: now_ms } };
}

export function lossSentence({ to }: { readonly to: string | null }): string {
  const how =
    to === null
      ? "Control of this page has ended: it was not heard for too long, or the service was started again."
      : `${to} has taken over control from this page.`;
  return `${how} What you press here commands nothing until you take control.`;
}

/** Control that is asked for and handed over: what is said of it, and what stands on this page of it. */

/** What a person is about to say of control: asking the holder, offering it to somebody, answering who asks. */
export type ControlForm =
  | { readonly kind: "ask" }
  | { readonly kind: "offer" }
  | { readonly kind: "answer"; readonly number: number };

/** What a notice lets its reader do. */
export type Deed = "answer" | "withdraw" | "take" | "decline" | "read";

export interface Notice {
  readonly wish: Wish;
  readonly text: string;
  readonly deeds: readonly Deed[];
  /** Whether it wants something of its reader. */
  readonly urgent: boolean;
}

export const MOST_LETTERS = 200;

export function isAsked({ standing }: Wish): boolean {
  return standing === "asked";
}

/** Whether it waits for somebody. */
export function isOpen({ standing }: Wish): boolean {
  return standing === "asked" || standing === "offered" || standing === "handed";
}

/** The operators to whom control can be handed over. */
export function othersToGetControl(people: State["people"], me: string | undefined): string[] {
  return people.filter(({ name, role }) => role === "operator" && name !== me).map(({ name }) => name);
}

/** What somebody reads of a request or an offer; null where it is none of theirs. `holds`: at the page in control. */
export function noticeOf(wish: Wish, me: string, holds: boolean): Notice | null {
  const [text, deeds] = wish.name === me ? forWho(wish) : holds || wish.by === me ? forBy(wish) : [null, []];
  if (text === null) return null;
  return { wish, text, deeds, urgent: deeds.includes("answer") || deeds.includes("take") };
}

type Said = readonly [string | null, readonly Deed[]];

function forWho({ standing, by, reason, answer, offered }: Wish): Said {
  switch (standing) {
    case "asked":
      return [`You have asked ${by} for control.`, ["withdraw"]];
    case "offered":
      return [`${by} offers you control: “${reason}”`, ["take", "decline"]];
    case "handed":
      return [`${by} hands control over to you${answer ? `: “${answer}”` : "."}`, ["take"]];
    case "taken":
      return [`${by} has handed control over to you${answer ? `: “${answer}”` : "."}`, ["read"]];
    case "declined":
      return offered ? [null, []] : [`${by} keeps control: “${answer}”`, ["read"]];
    case "withdrawn":
      return offered ? [`${by} has taken the offer of control back.`, ["read"]] : [null, []];
    case "lapsed":
      return [offered ? `The control that ${by} offered was not taken in time.` : NOT_ANSWERED(by), ["read"]];
    case "freed":
      return [`${by} does not hold control any more.`, ["read"]];
    case "left":
      return [null, []];
  }
}

function forBy({ standing, name, reason, answer, offered }: Wish): Said {
  switch (standing) {
    case "asked":
      return [`${name} asks for control: “${reason}”`, ["answer"]];
    case "offered":
      return [`You have offered control to ${name}, and hold it until it is taken.`, ["withdraw"]];
    case "handed":
      return [`Handing control over to ${name}: you hold it until it is taken.`, ["withdraw"]];
    case "taken":
      return [`You have handed control over to ${name}.`, ["read"]];
    case "declined":
      if (!offered) return [null, []];
      return [`${name} did not take control${answer ? `: “${answer}”` : "."}`, ["read"]];
    case "lapsed":
      return [offered ? `${name} did not take the control offered.` : null, ["read"]];
    case "left":
      return [`${name} has left; you hold control.`, ["read"]];
    case "withdrawn":
    case "freed":
      return [null, []];
  }
}

const NOT_ANSWERED = (by: string) => `${by} has not answered: ask again, or take over.`;

/** Requests of this page itself: what is handed over to them is taken at once. */
const asked = new Set<number>();

export function askedHere({ number, offered }: Wish): boolean {
  return !offered && asked.has(number);
}

export function useAsk() {
  return useMutation({
    mutationFn: async (reason: string) => {
      const wish = (await answeredBy(sayOfControl("wishes", { reason }))) as Wish;
      asked.add(wish.number);
    },
  });
}

export function useOffer() {
  return useMutation({
    mutationFn: (offer: { to: string; reason: string }) => answeredBy(sayOfControl("wishes", offer)),
  });
}

interface WishAnswer {
  readonly number: number;
  readonly answer: "hand_over" | "decline";
  readonly reason?: string;
}

export function useAnswer() {
  return useMutation({
    mutationFn: ({ number, ...said }: WishAnswer) => answeredBy(sayOfControl(`wishes/${number}`, said)),
  });
}

export function useTakeHanded() {
  return useMutation({ mutationFn: (number: number) => answeredBy(takeHanded(number)) });
}

/** Whether the signed-in person may change anything: a viewer looks on, and may press STOP. */

/** Null while it is not known yet. */
export function useMayCommand(): boolean | null {
  const { data } = useQuery(sessionQuery);
  return data === undefined ? null : data.role === "operator";
}

/** Whether somebody else holds control, so that the service would refuse each command of this page. */

/** Why this page cannot command; null where it can, or would take control with its first command. */
export function useNoControl(): string | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  return useLive((live) => whyNoControl(live.state?.holder ?? null, epoch));
}

/** Why the tuning cannot be changed from this page; null where it can. */
export function useNoRetuning(): string | null {
  const noControl = useNoControl();
  return useLive((live) => whyNoRetuning(live.state, noControl));
}

/** `epoch` is the control that this page holds; null for none. Pure. */
export function whyNoControl(holder: State["holder"], epoch: number | null): string | null {
  if (holder === null || holder.lost) return null;
  // a newer control than the state's holder has: the state that names this page is on its way
  if (epoch !== null && epoch >= holder.epoch) return null;
  return `${holder.name} holds control${holder.page ? "" : " by a script"}.`;
}

/** How long a refusal stands: each has a cause, and the message goes when its cause does. Pure. */

/** What a refusal is about, and so what ends it. */
type Cause = "control" | "link" | "moment" | "value";

/** A refusal with the circumstances in which it was given. */
export interface Standing {
  readonly error: Error | null;
  readonly circumstances: string;
  readonly since_ms: number;
  readonly over: boolean;
}

export const NOTHING: Standing = { error: null, circumstances: "", since_ms: 0, over: true };

/** The state that belongs to a refusal may come after it; what changes by then is no end. */
const SETTLE_MS = 600;

/** Whether a request was refused for who holds control: taking control is the remedy. */
export function isAboutControl(error: Error | null): boolean {
  return error instanceof RequestError && error.problem?.code.startsWith("control_") === true;
}

function causeOf(error: Error): Cause {
  if (!(error instanceof RequestError)) return "value";
  if (error.status === 0) return "link";
  if (isAboutControl(error)) return "control";
  return error.status === 409 || error.status === 503 ? "moment" : "value";
}

/**
 * What has to stay as it is for the refusal to hold. `epoch` is the control that this page holds, `about` what the
 * refused request would have changed, as it is in force.
 */
export function circumstances(error: Error, live: Live, epoch: number | null, about: unknown): string {
  const { state, link } = live;
  switch (causeOf(error)) {
    case "control":
      return JSON.stringify([epoch, state?.holder?.epoch]);
    case "link":
      return JSON.stringify([link.opened_ms, about]);
    case "moment":
      return JSON.stringify([
        state?.mode,
        state?.fault?.code,
        state?.task?.run,
        state?.trial === null,
        state?.pretension_done,
        state?.link.starts,
        about,
      ]);
    case "value":
      return JSON.stringify(about ?? null);
  }
}

/** The refusal as it stands now; one that is over does not come back, whatever returns. */
export function stands(before: Standing, error: Error | null, now: string, now_ms: number): Standing {
  if (error !== before.error) return { error, circumstances: now, since_ms: now_ms, over: error === null };
  if (before.over || now === before.circumstances) return before;
  if (now_ms - before.since_ms < SETTLE_MS) return { ...before, circumstances: now };
  return { ...before, over: true };
}

/** A refusal for as long as its cause lasts. */

/** `error` until what caused it is gone; `about` is what the request would have changed, as it is in force. */
export function useErrorLifetime(error: Error | null | undefined, about?: unknown): Error | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const refused = error ?? null;
  const now = useLive((live) => (refused === null ? "" : circumstances(refused, live, epoch, about)));
  const [before, keep] = useState(NOTHING);
  const standing = stands(before, refused, now, performance.now());
  if (standing !== before) keep(standing);
  return standing.over ? null : refused;
}
