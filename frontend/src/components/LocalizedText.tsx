/** A text of the service, with the angles in it as this person reads them. */

import { inWords } from "../samples/quantity";
import { useAngles } from "../service/angles";

export function LocalizedText({ text }: { text: string }) {
  return <>{inWords(text, useAngles())}</>;
}
