/** Control that is asked for, offered and handed over between people. */

import { useMutation } from "@tanstack/react-query";
import { fillText } from "../../samples/texts";
import { answeredBy } from "../../wire/client";
import { postControl, takeHanded } from "../../wire/control";
import type { HandoverRequest, State } from "../../wire/types";
import { TEXTS } from "../texts";

/** Control that is asked for and handed over: what is said of it, and what stands on this page of it. */

/** What a person is about to say of control: asking the holder, offering it to somebody, answering who asks. */
export type ControlForm =
  | { readonly kind: "ask" }
  | { readonly kind: "offer" }
  | { readonly kind: "answer"; readonly number: number };

/** What a notice lets its reader do. */
export type NoticeAction = "answer" | "withdraw" | "take" | "decline" | "read";

export interface Notice {
  readonly wish: HandoverRequest;
  readonly text: string;
  readonly actions: readonly NoticeAction[];
  /** Whether it wants something of its reader. */
  readonly urgent: boolean;
}

export const MOST_LETTERS = 200;

export function isRequested({ standing }: HandoverRequest): boolean {
  return standing === "asked";
}

/** Whether it waits for somebody. */
export function isOpen({ standing }: HandoverRequest): boolean {
  return standing === "asked" || standing === "offered" || standing === "handed";
}

/** The operators to whom control can be handed over. */
export function othersToGetControl(people: State["people"], me: string | undefined): string[] {
  return people.filter(({ name, role }) => role === "operator" && name !== me).map(({ name }) => name);
}

/** What somebody reads of a request or an offer; null where it is none of theirs. `holds`: at the page in control. */
export function noticeOf(wish: HandoverRequest, me: string, holds: boolean): Notice | null {
  const [text, actions] =
    wish.name === me ? forWho(wish) : holds || wish.by === me ? forBy(wish) : [null, []];
  if (text === null) return null;
  return { wish, text, actions, urgent: actions.includes("answer") || actions.includes("take") };
}

type NoticeText = readonly [string | null, readonly NoticeAction[]];

function forWho({ standing, by, reason, answer, offered }: HandoverRequest): NoticeText {
  switch (standing) {
    case "asked":
      return [fillText(TEXTS.asked, { name: by }), ["withdraw"]];
    case "offered":
      return [fillText(TEXTS.offered, { name: by, reason }), ["take", "decline"]];
    case "handed":
      return [because(TEXTS.handing, TEXTS.handingBecause, by, answer), ["take"]];
    case "taken":
      return [because(TEXTS.handed, TEXTS.handedBecause, by, answer), ["read"]];
    case "declined":
      return offered ? [null, []] : [fillText(TEXTS.declined, { name: by, answer }), ["read"]];
    case "withdrawn":
      return offered ? [fillText(TEXTS.offerWithdrawn, { name: by }), ["read"]] : [null, []];
    case "lapsed":
      return [fillText(offered ? TEXTS.offerLapsed : TEXTS.notAnswered, { name: by }), ["read"]];
    case "freed":
      return [fillText(TEXTS.freed, { name: by }), ["read"]];
    case "left":
      return [null, []];
  }
}

function forBy({ standing, name, reason, answer, offered }: HandoverRequest): NoticeText {
  switch (standing) {
    case "asked":
      return [fillText(TEXTS.wishOfOther, { name, reason }), ["answer"]];
    case "offered":
      return [fillText(TEXTS.offerSent, { name }), ["withdraw"]];
    case "handed":
      return [fillText(TEXTS.handingTo, { name }), ["withdraw"]];
    case "taken":
      return [fillText(TEXTS.handedTo, { name }), ["read"]];
    case "declined":
      if (!offered) return [null, []];
      return [because(TEXTS.offerDeclined, TEXTS.offerDeclinedBecause, name, answer), ["read"]];
    case "lapsed":
      return [offered ? fillText(TEXTS.offerNotTaken, { name }) : null, ["read"]];
    case "left":
      return [fillText(TEXTS.left, { name }), ["read"]];
    case "withdrawn":
    case "freed":
      return [null, []];
  }
}

/** The text with the answer where there is one. */
function because(
  plain: typeof TEXTS.handing | typeof TEXTS.handed | typeof TEXTS.offerDeclined,
  reasoned: typeof TEXTS.handingBecause | typeof TEXTS.handedBecause | typeof TEXTS.offerDeclinedBecause,
  name: string,
  answer: string,
): string {
  return answer ? fillText(reasoned, { name, answer }) : fillText(plain, { name });
}

/** Requests of this page itself: what is handed over to them is taken at once. */
const asked = new Set<number>();

export function isRequestOfThisPage({ number, offered }: HandoverRequest): boolean {
  return !offered && asked.has(number);
}

export function useRequestControl() {
  return useMutation({
    mutationFn: async (reason: string) => {
      const wish = (await answeredBy(postControl("wishes", { reason }))) as HandoverRequest;
      asked.add(wish.number);
    },
  });
}

export function useOfferControl() {
  return useMutation({
    mutationFn: (offer: { to: string; reason: string }) => answeredBy(postControl("wishes", offer)),
  });
}

interface RequestAnswer {
  readonly number: number;
  readonly answer: "hand_over" | "decline";
  readonly reason?: string;
}

export function useAnswerRequest() {
  return useMutation({
    mutationFn: ({ number, ...said }: RequestAnswer) => answeredBy(postControl(`wishes/${number}`, said)),
  });
}

export function useTakeHandedControl() {
  return useMutation({ mutationFn: (number: number) => answeredBy(takeHanded(number)) });
}
