/** Limits an error to one part of the page, and shows the error with a button that loads the part again. */

import { Button } from "@mantine/core";
import { Component, type ReactNode } from "react";
import { fillText } from "../samples/texts";
import styles from "./Boundary.module.css";
import { TEXTS } from "./texts";

interface BoundaryProps {
  /** Name of the part in the message. */
  readonly of: string;
  /** Content of the part, such as its address; a change clears the error. */
  readonly at?: string;
  readonly children: ReactNode;
}

export class ErrorBoundary extends Component<BoundaryProps, { readonly error: unknown }> {
  override state: { readonly error: unknown } = { error: null };

  static getDerivedStateFromError(error: unknown): { readonly error: unknown } {
    return { error: error ?? TEXTS.noReason };
  }

  override componentDidUpdate(before: BoundaryProps): void {
    if (before.at !== this.props.at && this.state.error !== null) this.setState({ error: null });
  }

  override render(): ReactNode {
    const { error } = this.state;
    if (error === null) return this.props.children;
    const reason = error instanceof Error ? error.message : String(error);
    return (
      <div
        role="alert"
        aria-label={fillText(TEXTS.failed, { part: this.props.of })}
        className={styles.failed}
      >
        <p>
          <strong>{fillText(TEXTS.failedTitle, { part: this.props.of })}</strong>{" "}
          {fillText(TEXTS.failedHint, { reason })}
        </p>
        <div className={styles.remedies}>
          <Button size="compact-sm" variant="default" onClick={() => this.setState({ error: null })}>
            {TEXTS.retry}
          </Button>
          <Button size="compact-sm" variant="default" onClick={() => globalThis.location.reload()}>
            {TEXTS.reload}
          </Button>
        </div>
      </div>
    );
  }
}
