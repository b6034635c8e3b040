/** Handover of the control lease between people: requests, offers, answers and notices. */

import { useMutation } from "@tanstack/react-query";
import { fillText } from "../../samples/texts";
import { answeredBy } from "../../wire/client";
import { postControl, takeHanded } from "../../wire/control";
import type { HandoverRequest, State } from "../../wire/types";
import { TEXTS } from "../texts";

/** Form that is open: a request to the holder, an offer, or the answer to a request. */
export type ControlForm =
  | { readonly kind: "ask" }
  | { readonly kind: "offer" }
  | { readonly kind: "answer"; readonly number: number };

/** Action that a notice offers. */
export type NoticeAction = "answer" | "withdraw" | "take" | "decline" | "read";

export interface Notice {
  readonly wish: HandoverRequest;
  readonly text: string;
  readonly actions: readonly NoticeAction[];
  /** Whether the notice requires an action. */
  readonly urgent: boolean;
}

export const MOST_LETTERS = 200;

export function isRequested({ standing }: HandoverRequest): boolean {
  return standing === "asked";
}

/** Whether the request or offer is pending. */
export function isOpen({ standing }: HandoverRequest): boolean {
  return standing === "asked" || standing === "offered" || standing === "handed";
}

/** Returns the names of the operators who can receive control. */
export function othersToGetControl(people: State["people"], me: string | undefined): string[] {
  return people.filter(({ name, role }) => role === "operator" && name !== me).map(({ name }) => name);
}

/** Returns the notice of a request or offer; null if it does not concern this person. `holds`: page in control. */
export function noticeOf(wish: HandoverRequest, me: string, holds: boolean): Notice | null {
  const [text, actions] =
    wish.name === me
      ? noticeForRecipient(wish)
      : holds || wish.by === me
        ? noticeForHolder(wish)
        : [null, []];
  if (text === null) return null;
  return { wish, text, actions, urgent: actions.includes("answer") || actions.includes("take") };
}

type NoticeText = readonly [string | null, readonly NoticeAction[]];

function noticeForRecipient({ standing, by, reason, answer, offered }: HandoverRequest): NoticeText {
  switch (standing) {
    case "asked":
      return [fillText(TEXTS.asked, { name: by }), ["withdraw"]];
    case "offered":
      return [fillText(TEXTS.offered, { name: by, reason }), ["take", "decline"]];
    case "handed":
      return [withAnswer(TEXTS.handing, TEXTS.handingBecause, by, answer), ["take"]];
    case "taken":
      return [withAnswer(TEXTS.handed, TEXTS.handedBecause, by, answer), ["read"]];
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

function noticeForHolder({ standing, name, reason, answer, offered }: HandoverRequest): NoticeText {
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
      return [withAnswer(TEXTS.offerDeclined, TEXTS.offerDeclinedBecause, name, answer), ["read"]];
    case "lapsed":
      return [offered ? fillText(TEXTS.offerNotTaken, { name }) : null, ["read"]];
    case "left":
      return [fillText(TEXTS.left, { name }), ["read"]];
    case "withdrawn":
    case "freed":
      return [null, []];
  }
}

/** Returns the text, with the answer if there is one. */
function withAnswer(
  plain: typeof TEXTS.handing | typeof TEXTS.handed | typeof TEXTS.offerDeclined,
  reasoned: typeof TEXTS.handingBecause | typeof TEXTS.handedBecause | typeof TEXTS.offerDeclinedBecause,
  name: string,
  answer: string,
): string {
  return answer ? fillText(reasoned, { name, answer }) : fillText(plain, { name });
}

/** Numbers of the requests of this page: it takes the control lease as soon as the holder hands it over. */
const ownRequests = new Set<number>();

export function isRequestOfThisPage({ number, offered }: HandoverRequest): boolean {
  return !offered && ownRequests.has(number);
}

export function useRequestControl() {
  return useMutation({
    mutationFn: async (reason: string) => {
      const request = (await answeredBy(postControl("wishes", { reason }))) as HandoverRequest;
      ownRequests.add(request.number);
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
    mutationFn: ({ number, ...body }: RequestAnswer) => answeredBy(postControl(`wishes/${number}`, body)),
  });
}

export function useTakeHandedControl() {
  return useMutation({ mutationFn: (number: number) => answeredBy(takeHanded(number)) });
}
