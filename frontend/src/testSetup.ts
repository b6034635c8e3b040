/** How long a test waits for what it asks for: as long as a busy machine may need. What never comes still fails. */

import { configure } from "@testing-library/dom";

configure({ asyncUtilTimeout: 20_000 });
