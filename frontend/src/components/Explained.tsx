import {
  createContext,
  type FocusEvent,
  type HTMLAttributes,
  type KeyboardEvent,
  type PointerEvent,
  type ReactNode,
  useContext,
  useEffect,
  useMemo,
  useState,
  useSyncExternalStore,
} from "react";
import {
  closeExplanation,
  currentExplanation,
  type Entry,
  entryOf,
  explain,
  pointerLeft,
} from "../service/glossary";
import styles from "./Explained.module.css";

/**
 * Group of terms with explanations that is one tab stop; the arrow keys move within it. So the explanations add only
 * one tab stop for each part of a page.
 */

interface Group {
  /** Term that has the tab stop. */
  current(): HTMLElement | null;
  subscribe(listener: () => void): () => void;
  add(term: HTMLElement): () => void;
  enter(term: HTMLElement): void;
  size(): number;
  move(event: KeyboardEvent<HTMLElement>): void;
}

const STEPS: Readonly<Record<string, number>> = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

function group(): Group {
  const terms = new Set<HTMLElement>();
  const listeners = new Set<() => void>();
  let at: HTMLElement | null = null;
  const inOrder = () =>
    [...terms].sort((a, b) => (a.compareDocumentPosition(b) & Node.DOCUMENT_POSITION_FOLLOWING ? -1 : 1));
  const become = (term: HTMLElement | null) => {
    if (term === at) return;
    at = term;
    for (const listener of listeners) listener();
  };
  return {
    current: () => at,
    subscribe(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    add(term) {
      terms.add(term);
      if (at === null) become(term);
      return () => {
        terms.delete(term);
        if (at === term) become(inOrder()[0] ?? null);
      };
    },
    enter: become,
    size: () => terms.size,
    move(event) {
      const ordered = inOrder();
      const here = ordered.indexOf(event.currentTarget);
      const ends: Readonly<Record<string, number>> = { Home: 0, End: ordered.length - 1 };
      const step = STEPS[event.key];
      const to = ends[event.key] ?? (step === undefined ? undefined : here + step);
      if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      ordered[to]?.focus();
    },
  };
}

const GroupContext = createContext<Group | null>(null);

function useGroup(): Group | null {
  return useContext(GroupContext);
}

const never = () => () => {};

/** Whether a term has a tab stop: one term per group, and each term without a group. */
function useTabStop(of: Group | null, term: HTMLElement | null): boolean {
  const at = useSyncExternalStore(of?.subscribe ?? never, () => of?.current() ?? null);
  return of === null || (term !== null && at === term);
}

export function Terms({ children }: { children: ReactNode }) {
  const one = useMemo(group, []);
  return <GroupContext value={one}>{children}</GroupContext>;
}

/** Term that shows its glossary entry on hover, focus or tap. */

/** A key of the glossary, an entry, or several that are explained together; unknown keys are ignored. */
export type Meaning = string | Entry | undefined | readonly (Entry | undefined)[];

export function entriesOf(of: Meaning): readonly Entry[] {
  const listed = typeof of === "string" ? [entryOf(of)] : Array.isArray(of) ? of : [of as Entry | undefined];
  return listed.filter((entry) => entry !== undefined);
}

export type Handlers = Pick<
  HTMLAttributes<HTMLElement>,
  "onPointerEnter" | "onPointerLeave" | "onFocus" | "onBlur" | "onInput"
>;

/** Handlers for a control that is also a term, such as a switch of a legend; they do not handle its keys and taps. */
export function explaining(entries: readonly Entry[]): Handlers {
  if (entries.length === 0) return {};
  return {
    onPointerEnter(event: PointerEvent<HTMLElement>) {
      if (event.pointerType !== "touch") explain({ anchor: event.currentTarget, entries, by: "pointer" });
    },
    onPointerLeave: pointerLeft,
    onFocus(event: FocusEvent<HTMLElement>) {
      const anchor = event.currentTarget;
      if (anchor.matches(":focus-visible")) explain({ anchor, entries, by: "focus" });
    },
    onBlur: (event: FocusEvent<HTMLElement>) => closeExplanation(event.currentTarget),
  };
}

interface ExplainedProps {
  readonly of: Meaning;
  /** Without underline, for a whole sentence or an element that is conspicuous itself. */
  readonly quiet?: boolean;
  readonly children: ReactNode;
}

export function Explained({ of, quiet = false, children }: ExplainedProps) {
  const entries = entriesOf(of);
  if (entries.length === 0) return <>{children}</>;
  return (
    <Term entries={entries} quiet={quiet}>
      {children}
    </Term>
  );
}

function Term({
  entries,
  quiet,
  children,
}: {
  entries: readonly Entry[];
  quiet: boolean;
  children: ReactNode;
}) {
  const group = useGroup();
  const [term, setTerm] = useState<HTMLElement | null>(null);
  const stop = useTabStop(group, term);
  useEffect(() => (term === null ? undefined : group?.add(term)), [group, term]);
  const { onFocus, ...handlers } = explaining(entries);
  return (
    <dfn
      ref={setTerm}
      className={styles.term}
      data-quiet={quiet}
      tabIndex={stop ? 0 : -1}
      {...handlers}
      onFocus={(event) => {
        group?.enter(event.currentTarget);
        onFocus?.(event);
      }}
      onClick={(event) => {
        const anchor = event.currentTarget;
        if (currentExplanation()?.anchor === anchor && currentExplanation()?.by === "tap")
          closeExplanation(anchor);
        else explain({ anchor, entries, by: "tap" });
      }}
      onKeyDown={(event) => {
        if (event.key === "Enter") explain({ anchor: event.currentTarget, entries, by: "focus" });
        else group?.move(event);
      }}
    >
      {children}
    </dfn>
  );
}
