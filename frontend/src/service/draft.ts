/** A value that a person changes while the service may change it too. Pure. */

export type Draft =
  | { readonly kind: "following" }
  | { readonly kind: "editing"; readonly value: number }
  | { readonly kind: "sent"; readonly value: number };

export type DraftEvent =
  | { readonly kind: "edit"; readonly value: number }
  | { readonly kind: "send"; readonly value: number }
  | { readonly kind: "read-back" }
  | { readonly kind: "drop" };

export const FOLLOWING: Draft = { kind: "following" };

/**
 * What the control shows next. A value sent stays in sight until the service reports what is in force; one that is being
 * edited is not overwritten by reports.
 */
export function nextDraft(draft: Draft, event: DraftEvent): Draft {
  switch (event.kind) {
    case "edit":
      return { kind: "editing", value: event.value };
    case "send":
      return { kind: "sent", value: event.value };
    case "read-back":
      return draft.kind === "sent" ? FOLLOWING : draft;
    case "drop":
      return FOLLOWING;
  }
}

export function shown(draft: Draft, inForce: number): number {
  return draft.kind === "following" ? inForce : draft.value;
}
